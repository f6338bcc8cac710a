"""A training step of the same network (unet-lite) in TensorFlow and ours, in turn.

Same layers, batch, image size, loss and optimiser; random images and targets, as nothing of a step's time depends on them.
"""

import argparse
import os
import statistics
import subprocess
import time

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
os.environ.setdefault("CUDA_VISIBLE_DEVICES", "-1")

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--ours", required=True, help="the built example `steps`")
parser.add_argument("--threads", type=int, required=True)
parser.add_argument("--rounds", type=int, default=5)
parser.add_argument("--steps", type=int, default=20, help="steps of one round")
parser.add_argument("--batch", type=int, default=8)
args = parser.parse_args()

import numpy as np
import tensorflow as tf

tf.config.threading.set_intra_op_parallelism_threads(args.threads)
tf.config.threading.set_inter_op_parallelism_threads(1)
layers = tf.keras.layers


def unet_lite():
    levels, bottom = [8, 16, 32, 64, 96], 128
    image = x = tf.keras.Input((96, 320, 3))
    kept = []
    for channels in levels:
        for _ in range(2):
            x = layers.Conv2D(channels, 3, padding="same", activation="relu")(x)
        kept.append(x)
        x = layers.MaxPooling2D()(x)
    for _ in range(2):
        x = layers.Conv2D(bottom, 3, padding="same", activation="relu")(x)
    for level, channels in reversed(list(enumerate(levels))):
        x = layers.Conv2DTranspose(channels, 4, strides=2, padding="same", activation="relu")(x)
        if level > 0:
            x = layers.Concatenate()([x, kept[level]])
            x = layers.Conv2D(channels, 3, padding="same", activation="relu")(x)
    bias = tf.keras.initializers.Constant(-2.0)
    x = layers.Conv2D(1, 3, padding="same", activation="sigmoid", bias_initializer=bias)(x)
    return tf.keras.Model(image, x)


model = unet_lite()
optimizer = tf.keras.optimizers.Adam(1e-3)


@tf.function
def step(image, target, mask):
    with tf.GradientTape() as tape:
        map_ = model(image, training=True)
        loss = tf.reduce_sum(tf.abs(map_ - target) * mask) / tf.reduce_sum(mask)
    gradients = tape.gradient(loss, model.trainable_variables)
    optimizer.apply_gradients(zip(gradients, model.trainable_variables))
    return loss


random = np.random.default_rng(1)
image = tf.constant(random.random((args.batch, 96, 320, 3), dtype=np.float32))
target = tf.constant(random.random((args.batch, 96, 320, 1), dtype=np.float32))
mask = tf.ones_like(target)


def theirs():
    times = []
    for _ in range(args.steps):
        start = time.perf_counter()
        step(image, target, mask).numpy()
        times.append((time.perf_counter() - start) * 1e3)
    return statistics.median(times)


def ours():
    command = [args.ours, "unet-lite", str(args.steps), str(args.batch), str(args.threads)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


theirs()  # traced and warm
pairs = [(theirs(), ours()) for _ in range(args.rounds)]
a, b = (statistics.median(values) for values in zip(*pairs))
name = f"step-{args.threads}t"
print(f"{name}: TensorFlow {tf.__version__} {a:.1f} ms, ours {b:.1f} ms, {args.batch} images of 320x96 a step")
print(f"ratio {name} {statistics.median(x / y for x, y in pairs):.2f}")
