//! `learn/online`: trains a network on the stream that it predicts, in the background.

mod node;
mod params;
mod predictor;
mod round;
#[cfg(test)]
mod tests;

pub(crate) use node::Online;
