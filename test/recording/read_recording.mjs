// Reads a recording with @mcap/core as Foxglove does, decodes every message, and prints what it saw.
import { open } from 'node:fs/promises';
import { createRequire } from 'node:module';

const require = createRequire(`${process.argv[2]}/`);
const { McapIndexedReader } = require('@mcap/core');
const { parse } = require('@foxglove/rosmsg');
const { MessageReader } = require('@foxglove/rosmsg2-serialization');
const { decompress } = require('fzstd');

const file = await open(process.argv[3]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const data = new Uint8Array(Number(length));
    await file.read(data, 0, Number(length), Number(offset));
    return data;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
});
const decoders = new Map();
const topics = {};
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  const definition = parse(new TextDecoder().decode(schema.data), { ros2: true });
  decoders.set(channel.id, new MessageReader(definition));
  topics[channel.topic] = {
    type: schema.name,
    qos: channel.metadata.get('offered_qos_profiles') ?? '',
    count: 0,
  };
}
let last = null;
for await (const message of reader.readMessages()) {
  const topic = reader.channelsById.get(message.channelId).topic;
  const decoded = decoders.get(message.channelId).readMessage(message.data);
  topics[topic].count += 1;
  if (topic === '/motor_duty') {
    last = [Number(message.logTime), decoded.vector.x, decoded.vector.y];
  }
}
const metadata = [];
for await (const record of reader.readMetadata()) {
  metadata.push(record.name);
}
const attachments = [];
for await (const record of reader.readAttachments()) {
  attachments.push(record.name);
}
console.log(
  JSON.stringify({ profile: reader.header.profile, topics, last, metadata, attachments }),
);
await file.close();
