//! A stage that learns.

/// The nodes of a stage in which stereo trains a network.
macro_rules! lesson {
    () => {
        "    nodes:
      stereo: { kind: stereo/sgbm, inputs: { left: source/left, right: source/right } }
      edges: { kind: confidence/edges, inputs: { image: source/left } }
      samples: { kind: learn/samples, inputs: { image: source/left, target: stereo/disparity, mask: edges/mask } }
      train: { kind: learn/ssl, inputs: { samples: samples/samples } }
"
    };
}
