// Messages by topic of an MCAP file, each decoded as Foxglove does.
import fs from "fs";
import { McapIndexedReader } from "@mcap/core";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";

const bytes = fs.readFileSync(process.argv[2]);
const readable = {
  size: async () => BigInt(bytes.length),
  read: async (at, length) => new Uint8Array(bytes.subarray(Number(at), Number(at + length))),
};
const file = await McapIndexedReader.Initialize({ readable });
const readers = new Map();
const counts = {};
for await (const message of file.readMessages()) {
  const channel = file.channelsById.get(message.channelId);
  if (!readers.has(channel.id)) {
    const text = new TextDecoder().decode(file.schemasById.get(channel.schemaId).data);
    readers.set(channel.id, new MessageReader(parse(text, { ros2: true })));
  }
  readers.get(channel.id).readMessage(message.data);
  counts[channel.topic] = (counts[channel.topic] || 0) + 1;
}
console.log(JSON.stringify(counts));
