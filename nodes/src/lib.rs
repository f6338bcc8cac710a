//! All that can stand in a graph: sources, stereo, mono, confidence, fusion, filter, score.
