//! What a killed training is taken up from.
//!
//! A `.safetensors` file: parameters, Adam's moments and the best parameters as tensors, the rest as JSON in its metadata. It is
//! written beside its place and renamed, so that a kill at any moment leaves the one before or the new one, whole.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use depthloom_graphs::values::CurvePoint;
use depthloom_graphs::{Fault, Key};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::train::{Best, State};
use crate::networks::Layout;

/// Raised whenever files of before no longer fit.
const VERSION: u32 = 1;

/// Where a training's checkpoint lies.
#[derive(Debug)]
pub(super) struct Checkpoint {
    path: PathBuf,
}

/// What is no tensor. Floats are told by their bits: a resumed training has the very same.
#[derive(Serialize, Deserialize)]
struct Progress {
    version: u32,
    step: u64,
    since_point: (u64, u64),
    points: Vec<(u64, u64, Option<u64>, u64)>,
    best: Option<(u64, u64)>,
}

impl Checkpoint {
    /// The checkpoint of the training with this key.
    pub(super) fn of(folder: &Path, key: &Key) -> Self {
        Self { path: folder.join(format!("{key}.safetensors")) }
    }

    /// The state it holds; `None` if there is none, or it is damaged or of another version: then learning starts again.
    pub(super) fn load(&self, layout: &Layout) -> Option<State> {
        let bytes = fs::read(&self.path).ok()?;
        let (_, header) = SafeTensors::read_metadata(&bytes).ok()?;
        let progress: Progress = serde_json::from_str(header.metadata().as_ref()?.get("progress")?).ok()?;
        if progress.version != VERSION {
            return None;
        }
        let tensors = SafeTensors::deserialize(&bytes).ok()?;
        let read = |what: &str, name: &str, count: usize| -> Option<Vec<f32>> {
            let view = tensors.tensor(&format!("{what}.{name}")).ok()?;
            let (values, rest) = view.data().as_chunks::<4>();
            (view.dtype() == Dtype::F32 && rest.is_empty() && values.len() == count)
                .then(|| values.iter().copied().map(f32::from_le_bytes).collect())
        };
        let all = |what: &str| -> Option<Vec<Vec<f32>>> {
            layout.parameters.iter().map(|parameter| read(what, &parameter.name, parameter.len())).collect()
        };
        let moments = layout.parameters.iter().map(|parameter| {
            if parameter.frozen {
                return Some(Default::default());
            }
            let of = |what| read(what, &parameter.name, parameter.len());
            Some([of("first")?, of("second")?])
        });
        let point = |(step, loss, validation, rate): (u64, u64, Option<u64>, u64)| CurvePoint {
            step,
            loss: f64::from_bits(loss),
            validation: validation.map(f64::from_bits),
            learning_rate: f64::from_bits(rate),
        };
        let best = match progress.best {
            None => None,
            Some((step, error)) => Some(Best { step, error: f64::from_bits(error), values: all("best")? }),
        };
        Some(State {
            step: progress.step,
            values: all("value")?,
            moments: moments.collect::<Option<_>>()?,
            since_point: (f64::from_bits(progress.since_point.0), progress.since_point.1),
            points: progress.points.into_iter().map(point).collect(),
            best,
        })
    }

    /// Writes a state in place of the one before.
    pub(super) fn save(&self, layout: &Layout, state: &State) -> Result<(), Fault> {
        let failed = |error: &dyn std::fmt::Display| {
            Fault::new(format!("failed to write the checkpoint {}: {error}", self.path.display()))
                .remedy("make room there, or choose another --out")
        };
        let progress = Progress {
            version: VERSION,
            step: state.step,
            since_point: (state.since_point.0.to_bits(), state.since_point.1),
            points: state
                .points
                .iter()
                .map(|p| (p.step, p.loss.to_bits(), p.validation.map(f64::to_bits), p.learning_rate.to_bits()))
                .collect(),
            best: state.best.as_ref().map(|best| (best.step, best.error.to_bits())),
        };
        let progress = serde_json::to_string(&progress).map_err(|error| failed(&error))?;
        let mut tensors: Vec<(String, Vec<u8>, usize)> = Vec::new();
        let mut push = |what: &str, name: &str, values: &[f32]| {
            let bytes = values.iter().flat_map(|value| value.to_le_bytes()).collect();
            tensors.push((format!("{what}.{name}"), bytes, values.len()));
        };
        for (index, parameter) in layout.parameters.iter().enumerate() {
            push("value", &parameter.name, &state.values[index]);
            if !parameter.frozen {
                push("first", &parameter.name, &state.moments[index][0]);
                push("second", &parameter.name, &state.moments[index][1]);
            }
            if let Some(best) = &state.best {
                push("best", &parameter.name, &best.values[index]);
            }
        }
        let views: Result<Vec<_>, _> = tensors
            .iter()
            .map(|(name, bytes, count)| Ok((name, TensorView::new(Dtype::F32, vec![*count], bytes)?)))
            .collect();
        let views = views.map_err(|error: safetensors::SafeTensorError| failed(&error))?;
        let metadata = HashMap::from([("progress".to_owned(), progress)]);
        let bytes = safetensors::serialize(views, Some(metadata)).map_err(|error| failed(&error))?;
        let beside = self.path.with_extension("new");
        let folder = self.path.parent().unwrap_or(Path::new("."));
        fs::create_dir_all(folder)
            .and_then(|()| fs::write(&beside, bytes))
            .and_then(|()| fs::rename(&beside, &self.path))
            .map_err(|error| failed(&error))
    }

    /// Removes it: the training is whole. The folder goes with the last one.
    pub(super) fn remove(&self) {
        // A checkpoint that stays costs room and nothing else.
        let _ = fs::remove_file(&self.path);
        if let Some(folder) = self.path.parent() {
            let _ = fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use depthloom_graphs::Key;
    use depthloom_graphs::values::CurvePoint;

    use super::{Best, Checkpoint, State};
    use crate::networks::{Network, Size, layout};

    #[test]
    fn a_state_comes_back_bit_for_bit_and_a_damaged_one_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let layout = layout(Network::UnetLite, Size { width: 32, height: 32 });
        let (values, other) = (layout.start(1), layout.start(2));
        let points = vec![
            CurvePoint { step: 50, loss: 0.1 + 0.2, validation: Some(f64::MIN_POSITIVE), learning_rate: 1e-3 },
            CurvePoint { step: 100, loss: 1.0 / 3.0, validation: None, learning_rate: 1e-4 },
        ];
        let state = State {
            step: 123,
            moments: values.iter().map(|v| [v.clone(), v.iter().map(|v| v * v).collect()]).collect(),
            values,
            since_point: (0.1, 77),
            points,
            best: Some(Best { step: 50, error: 1.0 / 7.0, values: other }),
        };
        let checkpoint = Checkpoint::of(folder.path(), &Key::of_content(b"this training"));
        assert!(checkpoint.load(&layout).is_none());
        checkpoint.save(&layout, &state).unwrap();
        assert!(checkpoint.load(&layout) == Some(state));
        let whole = std::fs::read(&checkpoint.path).unwrap();
        for cut in [0, 7, 100, whole.len() - 1] {
            std::fs::write(&checkpoint.path, &whole[..cut]).unwrap();
            assert!(checkpoint.load(&layout).is_none(), "{cut} bytes");
        }
        checkpoint.remove();
        assert!(!checkpoint.path.exists());
    }
}
