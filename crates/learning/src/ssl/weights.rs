//! Pretrained weights brought to a network's parameters.

use std::path::Path;

use depthloom_graphs::Fault;

use crate::networks::ParameterLayout;
use crate::onnx::weights::{NamedTensor, decode_weights};

pub(super) fn read(path: &Path) -> Result<Vec<NamedTensor>, Fault> {
    let bytes = std::fs::read(path).map_err(|error| {
        Fault::new(format!("failed to read the weights {}", path.display()))
            .because(error)
            .remedy("set `weights` to a .safetensors or .onnx file")
    })?;
    decode_weights(path, &bytes).map_err(|error| {
        Fault::new("failed to read the pretrained weights")
            .because(error)
            .remedy("set `weights` to a .safetensors or .onnx file with f32 or f16 tensors")
    })
}

/// Puts what the file has in place of the first values.
pub(crate) fn fill(
    layout: &ParameterLayout,
    file: &[NamedTensor],
    path: &Path,
    values: &mut [Vec<f32>],
) -> Result<(), Fault> {
    for (tensor, values) in matched(layout, file, path)?.into_iter().zip(values) {
        if let Some(tensor) = tensor {
            values.clone_from(&tensor.values);
        }
    }
    Ok(())
}

/// The file's tensor of every parameter. Frozen parameters must be there; others may.
pub(crate) fn matched<'f>(
    layout: &ParameterLayout,
    file: &'f [NamedTensor],
    path: &Path,
) -> Result<Vec<Option<&'f NamedTensor>>, Fault> {
    let path = path.display();
    let mut matched = Vec::with_capacity(layout.parameters.len());
    for parameter in &layout.parameters {
        let Some(tensor) = file.iter().find(|tensor| tensor.name == parameter.name) else {
            if parameter.frozen {
                return Err(Fault::new(format!(
                    "{path} has no tensor `{}`, which is required because it is not trained",
                    parameter.name
                ))
                .remedy(format!("the names must be those of torchvision; the file has {}", some_names(file))));
            }
            matched.push(None);
            continue;
        };
        if tensor.dims != parameter.shape {
            let (name, have, want) = (&parameter.name, &tensor.dims, &parameter.shape);
            return Err(Fault::new(format!("`{name}` of {path} has the shape {have:?}, expected {want:?}"))
                .remedy("use weights of the same network"));
        }
        matched.push(Some(tensor));
    }
    if matched.iter().all(Option::is_none) {
        let wanted = layout.parameters.first().map_or("", |parameter| &parameter.name);
        return Err(Fault::new(format!("{path} does not contain any of the network's parameters (`{wanted}`, ...)"))
            .remedy(format!("the file has {}", some_names(file))));
    }
    Ok(matched)
}

fn some_names(file: &[NamedTensor]) -> String {
    let names: Vec<&str> = file.iter().take(4).map(|tensor| tensor.name.as_str()).collect();
    format!("{}{}", names.join(", "), if file.len() > names.len() { ", ..." } else { "" })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::{NamedTensor, fill};
    use crate::networks::{Network, Size, layout};

    const SIZE: Size = Size { width: 32, height: 32 };

    fn of_vgg(leave_out: &str, wrong: &str) -> Vec<NamedTensor> {
        let parameters = layout(Network::FcnVgg16.without_spread(), SIZE).parameters;
        let frozen = parameters.into_iter().filter(|p| p.frozen && p.name != leave_out);
        frozen
            .map(|p| {
                let mut dims = p.shape.clone();
                if p.name == wrong {
                    dims.push(1);
                }
                NamedTensor { values: vec![0.25; p.len()], name: p.name, dims }
            })
            .collect()
    }

    #[test]
    fn frozen_parameters_are_taken_from_the_file() {
        let layout = layout(Network::FcnVgg16.without_spread(), SIZE);
        let mut values = layout.start(1);
        fill(&layout, &of_vgg("", ""), Path::new("vgg.onnx"), &mut values).unwrap();
        for (parameter, values) in layout.parameters.iter().zip(&values) {
            assert_eq!(parameter.frozen, !values.is_empty() && values.iter().all(|&v| v == 0.25), "{}", parameter.name);
        }
        assert_eq!(layout.parameters.iter().filter(|p| p.frozen).count(), 16, "8 convolutions with their biases");
    }

    #[test]
    fn missing_tensors_and_wrong_shapes_are_named() {
        let layout = layout(Network::FcnVgg16.without_spread(), SIZE);
        let message = |file: &[NamedTensor]| {
            let fault = fill(&layout, file, Path::new("vgg.onnx"), &mut layout.start(1)).unwrap_err();
            format!("{} ({})", fault.chain(), fault.remedy_text().unwrap_or_default())
        };
        assert!(message(&of_vgg("features.7.bias", "")).contains("`features.7.bias`"));
        let shape_message = message(&of_vgg("", "features.5.weight"));
        assert!(shape_message.contains("the shape [128, 64, 3, 3, 1], expected [128, 64, 3, 3]"), "{shape_message}");
        assert!(message(&[]).contains("features.0.weight"));
    }
}
