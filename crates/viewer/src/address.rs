//! The address of the server.

use std::net::{SocketAddr, ToSocketAddrs as _};

use depthloom_graphs::ErrorMessage;

/// An address to serve at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServeAddress(SocketAddr);

impl ServeAddress {
    /// The default address, which only programs on this machine can connect to.
    pub const DEFAULT: &'static str = "127.0.0.1:8765";

    /// Reads `HOST:PORT`. Port 0 stands for any free port.
    ///
    /// # Errors
    /// If the text is not of that form, or the host is unknown.
    pub fn parse(text: &str) -> Result<Self, ErrorMessage> {
        let remedy = format!("give an address as HOST:PORT, for example {}", Self::DEFAULT);
        let unknown = |error: std::io::Error| {
            ErrorMessage::new(format!("the address `{text}` is not valid")).because(error).remedy(remedy.clone())
        };
        let first = text.to_socket_addrs().map_err(unknown)?.next();
        let no_host = || ErrorMessage::new(format!("the address `{text}` has no host")).remedy(remedy.clone());
        first.map(Self).ok_or_else(no_host)
    }

    /// Host and port.
    #[must_use]
    pub const fn socket(self) -> SocketAddr {
        self.0
    }

    /// A warning if programs on other machines can connect; `None` if only programs on this machine can.
    #[must_use]
    pub fn warning(self) -> Option<String> {
        let is_local = self.0.ip().to_canonical().is_loopback();
        (!is_local)
            .then(|| format!("anyone who can reach {} over the network can watch: the server has no password", self.0))
    }
}

#[cfg(test)]
mod tests {
    use super::ServeAddress;

    #[test]
    fn only_addresses_of_other_machines_get_a_warning() {
        let warning = |text: &str| ServeAddress::parse(text).unwrap().warning();
        for text in [ServeAddress::DEFAULT, "127.1.2.3:80", "[::1]:8765", "[::ffff:127.0.0.1]:1", "localhost:0"] {
            assert_eq!(warning(text), None, "{text}");
        }
        for text in ["0.0.0.0:8765", "[::]:8765", "192.168.1.7:8765"] {
            assert!(warning(text).unwrap().contains("can watch"), "{text}");
        }
    }

    #[test]
    fn an_invalid_address_is_named() {
        for text in ["8765", "127.0.0.1", "127.0.0.1:99999", ""] {
            let error = ServeAddress::parse(text).unwrap_err();
            assert_eq!(error.to_string(), format!("the address `{text}` is not valid"));
            assert!(error.remedy.unwrap().ends_with("127.0.0.1:8765"));
        }
    }
}
