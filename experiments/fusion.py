"""The paper's fusion as two nodes of an experiment: own-python-node.yaml starts this program, once a worker that needs it."""

import numpy as np

import depthloom


@depthloom.node(inputs={"mono": "depth", "stereo": "depth"}, outputs={"depth": "depth"})
def scale(mono, stereo):  # float32 metres, NaN = no answer: arrays of (height, width)
    low_m, high_m, low_s, high_s = np.nanmin(mono), np.nanmax(mono), np.nanmin(stereo), np.nanmax(stereo)
    return low_s + (high_s - low_s) * (mono - low_m) / (high_m - low_m)


@depthloom.node(inputs={"mono": "depth", "stereo": "depth", "weight": "weight"}, outputs={"depth": "depth"})
def fuse(mono, stereo, weight):
    n_s, n_m = stereo / np.nanmax(stereo), mono / np.nanmax(mono)
    w_s = np.minimum(n_s, n_m) / np.maximum(n_s, n_m)
    both = weight * stereo + (1 - weight) * (w_s * stereo + (1 - w_s) * mono)
    return np.where(np.isnan(stereo), mono, np.where(np.isnan(both), stereo, both))


depthloom.serve(scale, fuse)
