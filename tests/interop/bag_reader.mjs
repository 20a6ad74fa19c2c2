// Decodes every message of an MCAP file with @mcap/core and prints how many each topic has, as JSON.
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import { parse } from "@foxglove/rosmsg";
import { MessageReader } from "@foxglove/rosmsg2-serialization";
import { open } from "node:fs/promises";

const file = await open(process.argv[2], "r");
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    const { bytesRead } = await file.read(buffer, 0, buffer.byteLength, Number(offset));
    if (bytesRead !== buffer.byteLength) {
      throw new Error(`read ${bytesRead} of ${length} bytes at ${offset}`);
    }
    return buffer;
  },
};
const decompressHandlers = await loadDecompressHandlers();
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const decoders = new Map();
const counts = {};
let last = 0n;
for (const channel of reader.channelsById.values()) {
  counts[channel.topic] = 0;
}
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  if (!decoders.has(channel.id)) {
    const definitions = parse(new TextDecoder().decode(schema.data), { ros2: true });
    decoders.set(channel.id, new MessageReader(definitions));
  }
  decoders.get(channel.id).readMessage(message.data);
  if (message.logTime < last) {
    throw new Error(`${channel.topic}: ${message.logTime} after ${last}`);
  }
  last = message.logTime;
  counts[channel.topic] += 1;
}
console.log(JSON.stringify(counts));
