//! Self-supervised learning of still-mono networks.
