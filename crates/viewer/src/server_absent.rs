//! In place of the server, in a build without the feature `serve`.

use std::net::SocketAddr;

use depthloom_graphs::ErrorMessage;
use depthloom_recording::MessageEncoder;

/// A server cannot exist in this build.
pub(crate) enum Server {}

impl Server {
    pub(crate) fn start(_address: SocketAddr, _name: &str, _channels: usize) -> Result<Self, ErrorMessage> {
        let remedy = "build depthloom with it: cargo install --path . --features serve";
        Err(ErrorMessage::new("this build of depthloom has no server: it lacks the feature `serve`").remedy(remedy))
    }

    pub(crate) const fn address(&self) -> SocketAddr {
        match *self {}
    }

    pub(crate) const fn is_subscribed(&self, _channel: u16) -> bool {
        match *self {}
    }

    pub(crate) const fn publish(
        &self,
        _encoder: &MessageEncoder,
        _channel: u16,
        _time_ns: u64,
        _message: &[u8],
    ) -> Result<bool, ErrorMessage> {
        match *self {}
    }
}
