// Foxglove's own client: subscribes to everything, decodes it, and drives by a Twist for 3 s.
import WebSocket from "ws";
import protocol from "@foxglove/ws-protocol";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const { FoxgloveClient } = protocol;
const socket = new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const subscribed = new Map();
const counts = {};
let speed = 0;
client.on("advertise", (channels) => {
  for (const channel of channels) {
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    subscribed.set(client.subscribe(channel.id), { topic: channel.topic, reader });
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const { topic, reader } = subscribed.get(subscriptionId);
  const message = reader.readMessage(data);
  counts[topic] = (counts[topic] || 0) + 1;
  if (topic === "/odom") speed = message.twist.twist.linear.x;
});
client.on("open", () => {
  const twist = { linear: { x: 0.5, y: 0, z: 0 }, angular: { x: 0, y: 0, z: 0.5 } };
  const raw = new TextEncoder().encode(JSON.stringify(twist));
  const id = client.advertise({ topic: "/cmd_vel", encoding: "json", schemaName: "geometry_msgs/Twist" });
  setInterval(() => client.sendMessage(id, raw), 100);
});
setTimeout(() => {
  console.log(JSON.stringify({ counts, speed }));
  process.exit(0);
}, 3000);
