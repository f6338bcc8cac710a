// Looks at a recording with the code of Lichtblick, Foxglove's open fork: its rule for calibrations, its camera model, its decoders of raw images and
// its grammar of message paths.
//
//     node check.mjs LICHTBLICK RECORDING LAYOUT...
//
// LICHTBLICK is a checkout (its packages are on no registry). Of every image that people look at, Lichtblick must find the calibration of its camera and take
// it; of a layout, every topic must be there, its calibration the one that Lichtblick would choose, and every plotted path a number. Prints what was looked at.
import { open, readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";

import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";
import esbuild from "esbuild";
import protobuf from "protobufjs";
import "protobufjs/ext/descriptor/index.js";

const require = createRequire(import.meta.url);
const [lichtblick, recording, ...layouts] = process.argv.slice(2);

/** A grammar of nearley's as a module, as Lichtblick's own build makes it. */
function grammarModule(text) {
  const nearley = require("nearley");
  const compile = require("nearley/lib/compile.js");
  const generate = require("nearley/lib/generate.js");
  const parser = new nearley.Parser(nearley.Grammar.fromCompiled(require("nearley/lib/nearley-language-bootstrapped.js")));
  parser.feed(text);
  return generate(compile(parser.results[0], {}), "grammar");
}

const at = (file) => JSON.stringify(path.resolve(lichtblick, "packages", file));
const built = await esbuild.build({
  stdin: {
    contents: `
      export * from ${at("den/image/decodings.ts")};
      export { PinholeCameraModel } from ${at("den/image/PinholeCameraModel.ts")};
      export { getTopicMatchPrefix } from ${at("suite-base/src/panels/ThreeDeeRender/renderables/Images/topicPrefixMatching.ts")};
      export { parseMessagePath } from ${at("message-path/src/parseMessagePath.ts")};
    `,
    resolveDir: import.meta.dirname,
  },
  bundle: true,
  write: false,
  format: "cjs",
  platform: "node",
  tsconfigRaw: {},
  nodePaths: [path.join(import.meta.dirname, "node_modules")],
  plugins: [
    {
      name: "nearley",
      setup: (build) =>
        build.onLoad({ filter: /\.ne$/ }, async (of) => ({ contents: grammarModule(await readFile(of.path, "utf8")) })),
    },
  ],
});
const module_ = { exports: {} };
new Function("module", "exports", "require", built.outputFiles[0].text)(module_, module_.exports, require);
const theirs = module_.exports;

const reader = await McapIndexedReader.Initialize({
  readable: new FileHandleReadable(await open(recording)),
  decompressHandlers: await loadDecompressHandlers(),
});
const types = new Map();
for (const [id, schema] of reader.schemasById) {
  types.set(id, protobuf.Root.fromDescriptor(schema.data).lookupType(schema.name));
}
const topics = new Map();
for await (const message of reader.readMessages()) {
  const channel = reader.channelsById.get(message.channelId);
  if (!topics.has(channel.topic)) {
    const type = types.get(channel.schemaId);
    const schema = reader.schemasById.get(channel.schemaId).name;
    topics.set(channel.topic, { schema, type, message: type.decode(message.data) });
  }
}

const faults = [];
const counts = { images: 0, pictures: 0, calibrations: 0, plots: 0 };

/** As `#getMatchingCalibrationTopic` of Lichtblick's image panel. */
function calibrationOf(image) {
  const prefix = theirs.getTopicMatchPrefix(image);
  const of = [...topics].find(([topic, { schema }]) => schema === "foxglove.CameraCalibration" && topic.startsWith(prefix));
  return of?.[0];
}

function cameraModel(topic) {
  const { width, height, distortion_model, D, K, R, P } = topics.get(topic).message;
  const roi = { x_offset: 0, y_offset: 0, width: 0, height: 0, do_rectify: false };
  return new theirs.PinholeCameraModel({
    width, height, D, K, R, P, roi, distortion_model, binning_x: 0, binning_y: 0,
  });
}

const raw = {
  rgb8: theirs.decodeRGB8,
  mono8: theirs.decodeMono8,
};

for (const [topic, { schema, message }] of topics) {
  if (schema === "foxglove.CameraCalibration") {
    const model = cameraModel(topic);
    const isInside = model.cx > 0 && model.cx < model.width && model.cy > 0 && model.cy < model.height;
    const isRight = topic.includes("/right/");
    if (!isInside || message.P[3] < 0 !== isRight) faults.push(`${topic}: ${message.P}`);
    counts.calibrations += 1;
  }
  if (schema !== "foxglove.RawImage" && schema !== "foxglove.CompressedImage") continue;
  const isPicture = topic.includes("/view/");
  if (!isPicture && !topic.endsWith("/image")) continue;
  counts.images += 1;
  const calibration = calibrationOf(topic);
  if (calibration == undefined || topics.get(calibration).message.frame_id !== message.frame_id) {
    faults.push(`${topic}: Lichtblick takes ${calibration}`);
    continue;
  }
  const model = cameraModel(calibration);
  let size;
  if (schema === "foxglove.RawImage") {
    size = [message.width, message.height];
    const pixels = new Uint8ClampedArray(4 * message.width * message.height);
    raw[message.encoding](message.data, message.width, message.height, message.step, pixels);
    if (new Set(pixels).size < 8) faults.push(`${topic}: nothing is seen in it`);
  } else {
    // A browser decodes it by this type; the PNG's header states size, 8 bits, indexed colours.
    if (message.format !== "png") faults.push(`${topic}: image/${message.format}`);
    const head = Buffer.from(message.data);
    if (head.toString("latin1", 1, 4) !== "PNG") faults.push(`${topic}: no PNG`);
    size = [head.readUInt32BE(16), head.readUInt32BE(20)];
    if (isPicture && (head[24] !== 8 || head[25] !== 3)) faults.push(`${topic}: no indexed colours`);
    counts.pictures += Number(isPicture);
  }
  if (size[0] !== model.width || size[1] !== model.height) faults.push(`${topic}: ${size} of ${model.width}, ${model.height}`);
}

/** What a layout plots, and which images it shows. */
function* configured(layout) {
  for (const [panel, config] of Object.entries(layout.configById)) yield [panel.split("!")[0], config];
}

for (const file of layouts) {
  for (const [panel, config] of configured(JSON.parse(await readFile(file, "utf8")))) {
    if (panel === "Image") {
      const { imageTopic, calibrationTopic } = config.imageMode;
      if (!topics.has(imageTopic)) faults.push(`${file}: no topic ${imageTopic}`);
      else if (calibrationTopic !== calibrationOf(imageTopic)) faults.push(`${file}: ${imageTopic} has ${calibrationTopic}`);
    }
    for (const { value } of config.paths ?? []) {
      const parsed = theirs.parseMessagePath(value);
      const of = parsed && topics.get(parsed.topicName);
      const names = (parsed?.messagePath ?? []).filter((part) => part.type === "name").map((part) => part.name);
      const field = of?.type.fieldsArray.find(({ name }) => name === names[0]);
      if (names.length !== 1 || field?.type !== "double") faults.push(`${file}: ${value} is not a number`);
      counts.plots += 1;
    }
  }
}
if (faults.length > 0) {
  console.error(faults.join("\n"));
  process.exit(1);
}
console.log(JSON.stringify(counts));
