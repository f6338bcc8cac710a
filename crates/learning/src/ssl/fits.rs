//! Checks that samples fit a training: before any frame as far as the wiring shows it, and again on the samples.

use std::io::Read;
use std::path::Path;

use depthloom_graphs::Fault;
use depthloom_graphs::contracts::{InputOrigin, Upstream};

use super::params::SslParams;
use crate::networks::Size;
use crate::samples::{CollectSamples, SamplesParams, SamplesView, size_and_right};
use crate::training::check_patience;

/// The common properties of the samples at a port.
#[derive(Clone, Copy, Debug)]
pub(super) struct Form {
    pub(crate) size: Size,
    pub(crate) has_right: bool,
    /// Whether depth in metres is known.
    pub(crate) has_depth: bool,
}

impl Form {
    pub(super) fn new(samples: &SamplesView<'_>) -> Self {
        let size = Size { width: samples.width(), height: samples.height() };
        Self { size, has_right: samples.has_right(), has_depth: samples.has_depth_scale() }
    }

    /// For samples that do not exist yet, as far as their origin shows it.
    fn to_come(origin: &InputOrigin<'_>) -> Option<Self> {
        match origin {
            InputOrigin::Node(node) => {
                let params: SamplesParams = node.params_of(CollectSamples::KIND)?;
                let [width, height] = params.size.map(|side| side as usize);
                let has = |port| node.is_wired(port);
                Some(Self { size: Size { width, height }, has_right: has("right"), has_depth: has("calibration") })
            }
            InputOrigin::File(path) => Self::of_file(path),
            InputOrigin::Source => None,
        }
    }

    /// From the first bytes of a file, which do not show whether each sample has a calibration. A file with other
    /// content is reported when it is read.
    fn of_file(path: &Path) -> Option<Self> {
        let mut head = Vec::new();
        std::fs::File::open(path).ok()?.take(64).read_to_end(&mut head).ok()?;
        let (width, height, has_right) = size_and_right(&head).ok()?;
        Some(Self { size: Size { width: width as usize, height: height as usize }, has_right, has_depth: true })
    }
}

impl SslParams {
    pub(super) fn check_upstream(&self, upstream: &Upstream<'_>) -> Result<(), Fault> {
        check_patience(&self.settings(), upstream.at("validation").is_some())?;
        let form = |port| upstream.at(port).and_then(Form::to_come);
        let Some(samples) = form("samples") else { return Ok(()) };
        self.check_form(&samples, form("validation").as_ref())
    }

    /// Checks that network and losses can use samples of this form.
    pub(super) fn check_form(&self, samples: &Form, validation: Option<&Form>) -> Result<(), Fault> {
        self.check_depth("samples", samples)?;
        if let Some(validation) = validation {
            self.check_depth("validation", validation)?;
        }
        self.check_size(samples.size)?;
        if let Some(Form { size, .. }) = validation
            && *size != samples.size
        {
            return Err(Fault::new(format!(
                "validation samples are {}x{}, samples {}x{}",
                size.width, size.height, samples.size.width, samples.size.height
            ))
            .remedy("set the same `size` for both `learn/samples`"));
        }
        if self.photometric > 0.0 && !samples.has_right {
            return Err(Fault::new("the photometric loss needs the right view, which the samples do not contain")
                .remedy("wire `right: source/right` at `learn/samples`"));
        }
        Ok(())
    }

    fn check_depth(&self, port: &str, samples: &Form) -> Result<(), Fault> {
        if !self.needs_depth() || samples.has_depth {
            return Ok(());
        }
        let network = self.network.name();
        Err(Fault::new(format!("depth cannot be computed from the samples at `{port}`: they have no calibration"))
            .remedy(format!(
                "wire `calibration: source/calibration` at `learn/samples`, which {network} with this loss needs"
            )))
    }

    fn check_size(&self, size: Size) -> Result<(), Fault> {
        let (network, multiple) = (self.network, self.network.multiple());
        if size.width.is_multiple_of(multiple) && size.height.is_multiple_of(multiple) {
            return Ok(());
        }
        let up = |side: usize| side.next_multiple_of(multiple);
        Err(Fault::new(format!(
            "{} requires images whose sides are multiples of {multiple}; the samples are {}x{}",
            network.name(),
            size.width,
            size.height
        ))
        .remedy(format!("set `size: [{}, {}]` at `learn/samples`", up(size.width), up(size.height))))
    }
}
