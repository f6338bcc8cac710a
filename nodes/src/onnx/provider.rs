//! Execution providers of ONNX Runtime. Which exist depends on the installed build; none is linked here.

use std::num::NonZeroUsize;

use ort::environment::Environment;
use ort::ep::{self, ExecutionProvider, ExecutionProviderDispatch};
use ort::session::builder::SessionBuilder;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Hardware that runs a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Provider {
    /// The CPU; every engine has it.
    #[default]
    Cpu,
    /// NVIDIA GPUs, through CUDA and cuDNN.
    Cuda,
    /// NVIDIA GPUs, through TensorRT; operators that it lacks run on CUDA.
    TensorRt,
    /// AMD GPUs, through `MIGraphX`.
    MiGraphX,
    /// Intel CPUs, GPUs and NPUs, through `OpenVINO`.
    OpenVino,
    /// Intel CPUs, through oneDNN.
    OneDnn,
    /// Any GPU on Windows.
    DirectMl,
    /// Apple CPUs, GPUs and Neural Engine.
    CoreMl,
    /// Qualcomm NPUs.
    Qnn,
    /// ARM and other CPUs, through XNNPACK.
    XnnPack,
}

impl Provider {
    /// All providers, the CPU first.
    pub const ALL: [Self; 10] = [
        Self::Cpu,
        Self::Cuda,
        Self::TensorRt,
        Self::MiGraphX,
        Self::OpenVino,
        Self::OneDnn,
        Self::DirectMl,
        Self::CoreMl,
        Self::Qnn,
        Self::XnnPack,
    ];

    /// The name in parameters.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Cuda => "cuda",
            Self::TensorRt => "tensorrt",
            Self::MiGraphX => "migraphx",
            Self::OpenVino => "openvino",
            Self::OneDnn => "onednn",
            Self::DirectMl => "directml",
            Self::CoreMl => "coreml",
            Self::Qnn => "qnn",
            Self::XnnPack => "xnnpack",
        }
    }

    /// Where a build of ONNX Runtime with this provider comes from.
    #[must_use]
    pub const fn remedy(self) -> &'static str {
        match self {
            Self::Cpu => "every build has it",
            Self::Cuda | Self::TensorRt => {
                "install a build that has it (`pip install onnxruntime-gpu` in a virtual environment without the package onnxruntime) \
                 and name its library by ORT_DYLIB_PATH, or use `provider: cpu`"
            }
            Self::OpenVino => {
                "install a build that has it (`pip install onnxruntime-openvino` in a virtual environment without the package onnxruntime) \
                 and name its library by ORT_DYLIB_PATH, or use `provider: cpu`"
            }
            _ => "name the library of a build that has it by ORT_DYLIB_PATH, or use `provider: cpu`",
        }
    }

    /// Whether the loaded ONNX Runtime was built with it.
    pub(crate) fn is_in_library(self) -> ort::Result<bool> {
        match self {
            Self::Cpu => Ok(true),
            Self::Cuda => ep::CUDA::is_available(),
            Self::TensorRt => ep::TensorRT::is_available(),
            Self::MiGraphX => ep::MIGraphX::is_available(),
            Self::OpenVino => ep::OpenVINO::is_available(),
            Self::OneDnn => ep::OneDNN::is_available(),
            Self::DirectMl => ep::DirectML::is_available(),
            Self::CoreMl => ep::CoreML::is_available(),
            Self::Qnn => ep::QNN::is_available(),
            Self::XnnPack => ep::XNNPACK::is_available(),
        }
    }

    /// Fails if the provider cannot be used; never falls back to the CPU.
    pub(crate) fn register(
        self,
        builder: SessionBuilder,
        environment: &Environment,
        threads: usize,
    ) -> ort::Result<SessionBuilder> {
        if self == Self::Cpu {
            // Left alone, ONNX Runtime chooses among all devices it knows. Builds without that choice name none.
            let processor = environment.devices().filter(|device| device.ep().is_ok_and(|ep| ep == ep::CPU::NAME));
            let processor: Vec<_> = processor.collect();
            return if processor.is_empty() { Ok(builder) } else { Ok(builder.with_devices(processor, None)?) };
        }
        let providers = self.dispatches(threads);
        let strict: Vec<_> = providers.into_iter().map(ExecutionProviderDispatch::error_on_failure).collect();
        Ok(builder.with_execution_providers(strict)?)
    }

    /// In order of preference.
    fn dispatches(self, threads: usize) -> Vec<ExecutionProviderDispatch> {
        // A search by stopwatch may choose another algorithm, with other bits, in every run.
        let cuda = || {
            ep::CUDA::default()
                .with_conv_algorithm_search(ep::cuda::ConvAlgorithmSearch::Heuristic)
                .with_tf32(false)
                .build()
        };
        let at_least_one = NonZeroUsize::new(threads).unwrap_or(NonZeroUsize::MIN);
        match self {
            Self::Cpu => Vec::new(),
            Self::Cuda => vec![cuda()],
            Self::TensorRt => vec![ep::TensorRT::default().build(), cuda()],
            Self::MiGraphX => vec![ep::MIGraphX::default().build()],
            Self::OpenVino => vec![ep::OpenVINO::default().with_num_threads(threads).build()],
            Self::OneDnn => vec![ep::OneDNN::default().build()],
            Self::DirectMl => vec![ep::DirectML::default().build()],
            Self::CoreMl => vec![ep::CoreML::default().build()],
            Self::Qnn => vec![ep::QNN::default().build()],
            Self::XnnPack => vec![ep::XNNPACK::default().with_intra_op_num_threads(at_least_one).build()],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Provider;

    #[test]
    fn names_are_those_of_the_parameter() {
        for provider in Provider::ALL {
            assert_eq!(serde_json::to_value(provider).unwrap(), provider.name());
        }
    }
}
