//! The server: Foxglove's WebSocket protocol, by Foxglove's SDK.

use std::net::SocketAddr;
use std::sync::{Arc, OnceLock};

use depthloom_graphs::ErrorMessage;
use depthloom_recording::MessageEncoder;
use foxglove::{Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};

/// The most messages per channel that wait for a client. If it does not read them, the oldest ones are dropped.
const BACKLOG: usize = 2;
const LEAST_BACKLOG: usize = 16;

pub(crate) struct Server {
    context: Arc<Context>,
    /// `None` once it stops.
    handle: Option<WebSocketServerHandle>,
    address: SocketAddr,
    /// By id, from 1 on.
    channels: Vec<OnceLock<Arc<RawChannel>>>,
}

impl Server {
    /// Listens at an address. `channels` is the number of channels.
    pub(crate) fn start(address: SocketAddr, name: &str, channels: usize) -> Result<Self, ErrorMessage> {
        let context = Context::new();
        let host = match address {
            SocketAddr::V4(address) => address.ip().to_string(),
            SocketAddr::V6(address) => format!("[{}]", address.ip()),
        };
        let server = context.websocket_server().name(name).bind(host, address.port());
        let server = server.message_backlog_size((BACKLOG * channels).max(LEAST_BACKLOG));
        let handle = server.start_blocking().map_err(|error| {
            let message = ErrorMessage::new(format!("failed to serve at {address}"));
            match error {
                FoxgloveError::Bind(error) => message
                    .because(error)
                    .remedy("end the program that uses the address, or choose another one with --serve"),
                other => message.because(other),
            }
        })?;
        let address = SocketAddr::new(address.ip(), handle.port());
        let channels = (0..channels).map(|_| OnceLock::new()).collect();
        Ok(Self { context, handle: Some(handle), address, channels })
    }

    /// The address with its actual port.
    pub(crate) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether a client receives the messages of a channel.
    pub(crate) fn is_subscribed(&self, channel: u16) -> bool {
        let channel = self.channels[usize::from(channel) - 1].get();
        channel.is_some_and(|channel| channel.has_sinks())
    }

    /// Passes a message to the clients of its channel, and returns whether there are any. The first message of a
    /// channel advertises it.
    pub(crate) fn publish(
        &self,
        encoder: &MessageEncoder,
        channel: u16,
        time_ns: u64,
        message: &[u8],
    ) -> Result<bool, ErrorMessage> {
        let place = &self.channels[usize::from(channel) - 1];
        let channel = match place.get() {
            Some(channel) => channel,
            None => {
                let advertised = self.advertise(encoder, channel)?;
                place.get_or_init(|| advertised)
            }
        };
        channel.log_with_meta(message, PartialMetadata::with_log_time(time_ns));
        Ok(channel.has_sinks())
    }

    fn advertise(&self, encoder: &MessageEncoder, channel: u16) -> Result<Arc<RawChannel>, ErrorMessage> {
        let (_, channel) =
            encoder.channels().nth(usize::from(channel) - 1).expect("messages have channels of the plan");
        let schema = Schema::new(channel.schema_name, "protobuf", channel.schema);
        let builder = self.context.channel_builder(channel.topic).message_encoding("protobuf").schema(schema);
        let built = builder.metadata(channel.metadata.clone()).build_raw();
        built.map_err(|error| ErrorMessage::new(format!("failed to offer topic {}", channel.topic)).because(error))
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // Without waiting for the clients, which could take as long as a client likes.
        drop(self.handle.take().map(WebSocketServerHandle::stop));
    }
}
