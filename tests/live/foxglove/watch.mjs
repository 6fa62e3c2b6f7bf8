// Foxglove's own client: subscribes to everything and decodes it for 3 s.
import WebSocket from "ws";
import protocol from "@foxglove/ws-protocol";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const { FoxgloveClient } = protocol;
const socket = new WebSocket(process.argv[2], [FoxgloveClient.SUPPORTED_SUBPROTOCOL]);
const client = new FoxgloveClient({ ws: socket });
const subscribed = new Map();
const counts = {};
client.on("advertise", (channels) => {
  for (const channel of channels) {
    const reader = new MessageReader(parse(channel.schema, { ros2: true }));
    subscribed.set(client.subscribe(channel.id), { topic: channel.topic, reader });
  }
});
client.on("message", ({ subscriptionId, data }) => {
  const { topic, reader } = subscribed.get(subscriptionId);
  reader.readMessage(data);
  counts[topic] = (counts[topic] || 0) + 1;
});
setTimeout(() => {
  console.log(JSON.stringify({ counts }));
  process.exit(0);
}, 3000);
