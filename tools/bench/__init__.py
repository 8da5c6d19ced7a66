"""Benchmarks: they print figures beside a named baseline of the same run, and are not tests."""
