// Reads logs with Foxglove's own code, as its panels do, and says what they would not show.
//
//     npm install --prefix tools/foxglove && node tools/foxglove/read.js LOG.mcap...
//
// One JSON object per log: messages of each topic that were decoded, and a line for each thing that is wrong. Exit status 1
// where anything is.

import { open } from "node:fs/promises";

import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";

const FLOATS = [7, 8]; // sensor_msgs/msg/PointField
const finite = (thing) => Object.values(thing).every(Number.isFinite);

// What a panel needs of a message beyond its type: a line that says what it has not, or nothing.
const NEEDS = {
  "sensor_msgs/msg/CompressedImage": ({ format, data }) => {
    const jpeg = data[0] === 0xff && data[1] === 0xd8;
    const png = data[0] === 0x89 && data[1] === 0x50;
    if (!jpeg && !png) return "neither JPEG nor PNG";
    return format.includes(jpeg ? "jpeg" : "png") ? undefined : `its format is called '${format}'`;
  },
  "sensor_msgs/msg/CameraInfo": ({ k, width, height }) =>
    k[0] > 0 && width > 0 && height > 0 ? undefined : "no intrinsics",
  "sensor_msgs/msg/PointCloud2": (cloud) => {
    const axes = ["x", "y", "z"].map((name) => cloud.fields.find((field) => field.name === name));
    if (axes.some((field) => field === undefined || !FLOATS.includes(field.datatype))) return "no x, y, z";
    if (cloud.row_step < cloud.width * cloud.point_step) return "rows are shorter than their points";
    return cloud.data.length === cloud.height * cloud.row_step ? undefined : "its data have another length";
  },
  "tf2_msgs/msg/TFMessage": ({ transforms }) => {
    for (const { header, child_frame_id, transform } of transforms) {
      const { x, y, z, w } = transform.rotation;
      if (!header.frame_id || !child_frame_id) return "a frame without a name";
      if (!finite(transform.translation) || Math.abs(Math.hypot(x, y, z, w) - 1) > 1e-3) return "no rigid transform";
    }
    return transforms.length > 0 ? undefined : "no transform";
  },
  "nav_msgs/msg/Odometry": ({ pose }) => (finite(pose.pose.position) ? undefined : "no position"),
  "diagnostic_msgs/msg/DiagnosticArray": ({ status }) =>
    status.length > 0 && status.every((one) => one.name && one.level <= 3) ? undefined : "a status without name or level",
};
const PLACED = ["sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/PointCloud2", "nav_msgs/msg/Odometry"];

async function read(path) {
  const file = await open(path);
  const counts = {};
  const problems = new Set();
  const parents = new Map(); // child frame -> parent frame
  const drawn = new Map(); // frame -> topic
  try {
    const readable = new FileHandleReadable(file);
    const decompressHandlers = await loadDecompressHandlers();
    const log = await McapIndexedReader.Initialize({ readable, decompressHandlers });
    const readers = new Map();
    for (const [id, { schemaId, messageEncoding }] of log.channelsById) {
      const { name, encoding, data } = log.schemasById.get(schemaId);
      if (messageEncoding !== "cdr" || encoding !== "ros2msg") throw new Error(`${name}: ${messageEncoding}, ${encoding}`);
      const definition = parse(new TextDecoder().decode(data), { ros2: true });
      readers.set(id, { name, reader: new MessageReader(definition) });
    }
    for await (const { channelId, data } of log.readMessages()) {
      const { topic } = log.channelsById.get(channelId);
      const { name, reader } = readers.get(channelId);
      const message = reader.readMessage(data);
      counts[topic] = (counts[topic] ?? 0) + 1;
      const wrong = NEEDS[name]?.(message);
      if (wrong) problems.add(`${topic}: ${wrong}`);
      for (const one of message.transforms ?? []) parents.set(one.child_frame_id, one.header.frame_id);
      if (PLACED.includes(name)) drawn.set(message.header.frame_id, topic);
    }
  } catch (error) {
    problems.add(error.message);
  } finally {
    await file.close();
  }
  const known = new Set([...parents.keys(), ...parents.values()]);
  for (const [frame, topic] of drawn) {
    if (!known.has(frame)) problems.add(`${topic}: no transform leads to its frame '${frame}'`);
  }
  return { path, counts, problems: [...problems] };
}

for (const path of process.argv.slice(2)) {
  const found = await read(path);
  console.log(JSON.stringify(found));
  if (found.problems.length > 0) process.exitCode = 1;
}
