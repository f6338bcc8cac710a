// A node in JavaScript, after docs/reference/process-protocol.md alone: of two depths the nearer one.
//
//   npm install && depthloom run nearest.yaml --allow-exec
import {
  Field, Float32, Int32, Int64, List, makeData, RecordBatch, RecordBatchReader, RecordBatchStreamWriter, Schema, Struct, Utf8,
} from 'apache-arrow';

// What is answered: `says`, the call's number, and the outputs. A map is its width, its height and its samples, row by row.
const floats = new List(new Field('item', new Float32(), false));
const map = new Struct([new Field('width', new Int32()), new Field('height', new Int32()), new Field('data', floats)]);
const outputs = new Struct([new Field('depth', map, true)]);
const schema = new Schema(
  [new Field('says', new Utf8()), new Field('number', new Int64()), new Field('message', new Utf8(), true), new Field('outputs', outputs, true)],
  new Map([['depthloom.protocol', '1']]),
);

// Columns of one row.
const one = (type, data) => makeData({ type, data, length: 1, nullCount: 0 });
const text = (words) => {
  const data = new TextEncoder().encode(words);
  return makeData({ type: new Utf8(), length: 1, nullCount: 0, data, valueOffsets: Int32Array.of(0, data.length) });
};
const list = (values) =>
  makeData({ type: floats, length: 1, nullCount: 0, valueOffsets: Int32Array.of(0, values.length), child: makeData({ type: new Float32(), data: values }) });
const struct = (type, children) => makeData({ type, length: 1, nullCount: 0, children });
const depth = ({ width, height, data }) =>
  struct(outputs, [struct(map, [one(new Int32(), Int32Array.of(width)), one(new Int32(), Int32Array.of(height)), list(data)])]);
const none = () => depth({ width: 1, height: 1, data: new Float32Array(1) });

const writer = new RecordBatchStreamWriter({ autoDestroy: false });
writer.toNodeStream().pipe(process.stdout);
writer.reset(undefined, schema);
const say = (says, number, values, message = '') => {
  const columns = [text(says), one(new Int64(), BigInt64Array.of(BigInt(number))), text(message), values];
  writer.write(new RecordBatch(schema, struct(new Struct(schema.fields), columns)));
};

// The samples stay in the received buffer and are not copied.
const read = (value) => ({ width: value.width, height: value.height, data: value.data.toArray() });

const calls = await (await RecordBatchReader.from(process.stdin)).open();
if (calls.schema.metadata.get('depthloom.protocol') !== '1') throw new Error('another protocol');
const { farthest = Infinity } = JSON.parse(calls.schema.metadata.get('depthloom.node')).params;
say('ready', 0, none());
for await (const batch of calls) {
  const { number, inputs } = batch.get(0);
  try {
    const [one, other] = [read(inputs.one), read(inputs.other)];
    // NaN is invalid: the other value is used.
    const nearer = one.data.map((z, i) => (z < other.data[i] || Number.isNaN(other.data[i]) ? z : other.data[i]));
    say('values', number, depth({ ...one, data: nearer.map((z) => (z > farthest ? NaN : z)) }));
  } catch (error) {
    say('failure', number, none(), String(error));
  }
}
