//! A network whose ports are declared, loaded: which tensor each port is.

use depthloom_graphs::Fault;
use depthloom_graphs::values::Artifact;

use super::params::{InputType, NetworkParams};
use crate::onnx::{self, Axes, Fitted, PoolInput, Pools, Sizes};

pub(super) struct Loaded {
    sizes: Sizes,
    /// Inputs and outputs in the order of the ports.
    pub pools: Pools,
}

impl Loaded {
    /// Loads the model at once if its inputs fix the size.
    pub(super) fn new(model: &Artifact, params: &NetworkParams) -> Result<Self, Fault> {
        let declared = onnx::declared(model, params.provider)?;
        let given: Vec<&str> = declared.inputs.iter().map(|input| input.name.as_str()).collect();
        let named = |what: &str, port: &str, name: Option<&String>, all: &[&str]| match (name, all) {
            (Some(name), _) => Ok(name.clone()),
            (None, _) if all.contains(&port) => Ok(port.to_owned()),
            (None, [only]) => Ok((*only).to_owned()),
            (None, _) => Err(Fault::new(format!("the network has no {what} `{port}`; it has {}", all.join(", ")))
                .remedy(format!("name the {what} of port `{port}`: `name: {}`", all.first().unwrap_or(&"NAME")))),
        };
        let mut inputs: Vec<PoolInput> = Vec::with_capacity(params.ports.inputs.len());
        for (port, input) in &params.ports.inputs {
            let name = named("input", port, input.name.as_ref(), &given)?;
            if inputs.iter().any(|other| other.name == name) {
                return Err(Fault::new(format!("two ports are input `{name}` of the network")).remedy(format!(
                    "name the input of port `{port}` with `name`; the network has {}",
                    given.join(", ")
                )));
            }
            let outlet = onnx::outlet("input", &declared.inputs, Some(&name))?;
            let axes = onnx::planes(outlet, input.layout)?;
            let planes = match (input.value_type, axes.channels) {
                (InputType::Image, None) => 3,
                (InputType::Image, Some(planes @ (1 | 3))) | (_, Some(planes @ 1)) => planes,
                (_, None) => 1,
                (_, Some(other)) => {
                    let wanted = if input.value_type == InputType::Image { "1 or 3" } else { "one" };
                    return Err(Fault::new(format!(
                        "input `{name}` of the network takes {other} channels, and port `{port}` has {wanted}"
                    ))
                    .remedy("see `layout`, or export the model with an input a port"));
                }
            };
            if axes.batch.is_some_and(|batch| batch != 1) {
                return Err(Fault::new(format!("input `{name}` of the network takes several images at once"))
                    .remedy("export the model with a batch of 1, or an open one"));
            }
            inputs.push(PoolInput { name, axes, images: 1, planes });
        }
        if let Some(unfed) = given.iter().find(|name| !inputs.iter().any(|fed| fed.name == **name)) {
            return Err(Fault::new(format!("no port feeds input `{unfed}` of the network"))
                .remedy("declare one under `ports.inputs`, with its `name`"));
        }
        let all: Vec<&str> = declared.outputs.iter().map(|output| output.name.as_str()).collect();
        let output = |(port, output): (&String, &super::params::NetworkOutput)| {
            let name = named("output", port, output.name.as_ref(), &all)?;
            onnx::outlet("output", &declared.outputs, Some(&name)).map(|outlet| outlet.name.clone())
        };
        let outputs = params.ports.outputs.iter().map(output).collect::<Result<_, _>>()?;
        let named: Vec<(&str, Axes)> = inputs.iter().map(|input| (input.name.as_str(), input.axes)).collect();
        let sizes = onnx::sizes(&named, params.size, params.multiple)?;
        let pools = Pools::new(model, (params.provider, params.threads), inputs, outputs);
        pools.load_fixed(sizes)?;
        Ok(Self { sizes, pools })
    }

    pub(super) fn fitted(&self, from: (usize, usize), params: &NetworkParams) -> Result<Fitted, Fault> {
        Fitted::new(from, self.sizes, params.fit, params.pad_at)
    }
}
