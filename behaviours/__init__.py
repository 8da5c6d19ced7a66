"""Obstacle avoidance, stabilisation and survey on the feed of the scanner: each decision explained, safety last."""
