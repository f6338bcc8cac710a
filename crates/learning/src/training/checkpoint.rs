//! Checkpoints, from which a training that was stopped or killed resumes.
//!
//! A `.safetensors` file, parameters, Adam's moments and the best parameters as tensors and the rest as JSON in its
//! metadata; after it the first 16 bytes of its BLAKE3 hash, so that a file which is not as it was written is seen. It
//! is written beside its place, synchronised and renamed: a kill or a power cut at any moment leaves the one before or
//! the new one, whole.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::{fs, io};

use depthloom_graphs::values::CurvePoint;
use depthloom_graphs::{Fault, Key, regular_file};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};

use super::steps::{Best, State};
use crate::networks::ParameterLayout;

/// Raised whenever older files can no longer be read.
const VERSION: u32 = 2;
const LARGEST: u64 = 1 << 40;
const HASH_LEN: usize = 16;

#[derive(Debug)]
pub(super) struct Checkpoint {
    path: PathBuf,
}

/// The state except tensors. Floats are stored as their bits, so that a resumed training has the same numbers.
#[derive(Serialize, Deserialize)]
struct Progress {
    version: u32,
    step: u64,
    since_point: (u64, u64),
    points: Vec<(u64, u64, Option<u64>, u64)>,
    best: Option<(u64, u64)>,
}

#[derive(Debug, thiserror::Error)]
pub(super) enum Unusable {
    #[error("the checkpoint {0} cannot be read: {1}")]
    Unreadable(PathBuf, io::Error),
    #[error("the checkpoint {0} is damaged")]
    Damaged(PathBuf),
    /// It is complete, but belongs to another program or training.
    #[error("the checkpoint {0} was written by another version")]
    Foreign(PathBuf),
}

impl Checkpoint {
    pub(super) const fn at(path: PathBuf) -> Self {
        Self { path }
    }

    /// The stored state; `None` if the file does not exist.
    pub(super) fn load(&self, layout: &ParameterLayout) -> Result<Option<State>, Unusable> {
        let bytes = match regular_file::read(&self.path, LARGEST) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(Unusable::Unreadable(self.path.clone(), error)),
        };
        match bytes.split_last_chunk::<HASH_LEN>() {
            Some((content, hash)) if Key::of_content(content).as_bytes() == hash => {
                decoded(content, layout).map(Some).ok_or_else(|| Unusable::Foreign(self.path.clone()))
            }
            _ => Err(Unusable::Damaged(self.path.clone())),
        }
    }

    pub(super) fn save(&self, layout: &ParameterLayout, state: &State) -> Result<(), Fault> {
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
        let mut bytes = safetensors::serialize(views, Some(metadata)).map_err(|error| failed(&error))?;
        bytes.extend_from_slice(Key::of_content(&bytes).as_bytes());
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let written = fs::create_dir_all(folder).and_then(|()| {
            depthloom_durable::remove_abandoned(folder);
            depthloom_durable::write(&self.path, &bytes)
        });
        written.map_err(|error| failed(&error))
    }
}

/// The state in the bytes of a checkpoint; `None` if they are not of this version and layout.
fn decoded(bytes: &[u8], layout: &ParameterLayout) -> Option<State> {
    let (_, header) = SafeTensors::read_metadata(bytes).ok()?;
    let progress: Progress = serde_json::from_str(header.metadata().as_ref()?.get("progress")?).ok()?;
    if progress.version != VERSION {
        return None;
    }
    let tensors = SafeTensors::deserialize(bytes).ok()?;
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
        let moment = |what| read(what, &parameter.name, parameter.len());
        Some([moment("first")?, moment("second")?])
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

#[cfg(test)]
mod tests {
    use depthloom_graphs::values::CurvePoint;

    use super::{Best, Checkpoint, State, Unusable};
    use crate::networks::{Network, ParameterLayout, Size, layout};

    fn state(layout: &ParameterLayout) -> State {
        let (values, other) = (layout.start(1), layout.start(2));
        let points = vec![
            CurvePoint { step: 50, loss: 0.1 + 0.2, validation: Some(f64::MIN_POSITIVE), learning_rate: 1e-3 },
            CurvePoint { step: 100, loss: 1.0 / 3.0, validation: None, learning_rate: 1e-4 },
        ];
        State {
            step: 123,
            moments: values.iter().map(|v| [v.clone(), v.iter().map(|v| v * v).collect()]).collect(),
            values,
            since_point: (0.1, 77),
            points,
            best: Some(Best { step: 50, error: 1.0 / 7.0, values: other }),
        }
    }

    #[test]
    fn a_state_reads_back_bit_for_bit_and_a_damaged_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let layout = layout(Network::UnetLite.without_spread(), Size { width: 32, height: 32 });
        let state = state(&layout);
        let checkpoint = Checkpoint::at(folder.path().join("checkpoints/this.checkpoint"));
        assert!(checkpoint.load(&layout).unwrap().is_none());
        checkpoint.save(&layout, &state).unwrap();
        assert!(checkpoint.load(&layout).unwrap() == Some(state));
        let whole = std::fs::read(&checkpoint.path).unwrap();
        for cut in [0, 7, 15, 16, 100, whole.len() - 1] {
            std::fs::write(&checkpoint.path, &whole[..cut]).unwrap();
            assert!(matches!(checkpoint.load(&layout), Err(Unusable::Damaged(_))), "{cut} bytes");
        }
        let other = crate::networks::layout(Network::FcnVgg16.without_spread(), Size { width: 32, height: 32 });
        std::fs::write(&checkpoint.path, &whole).unwrap();
        assert!(matches!(checkpoint.load(&other), Err(Unusable::Foreign(_))));
    }

    #[test]
    fn fault_46_a_flipped_bit_of_a_checkpoint_is_detected() {
        let folder = tempfile::tempdir().unwrap();
        let layout = layout(Network::FcnLite.without_spread(), Size { width: 32, height: 32 });
        let checkpoint = Checkpoint::at(folder.path().join("this.checkpoint"));
        checkpoint.save(&layout, &state(&layout)).unwrap();
        let mut bytes = std::fs::read(&checkpoint.path).unwrap();
        let mut random = depthloom_random::SplitMix64::new(46);
        let anywhere: Vec<usize> = (0..60).map(|_| random.below(bytes.len() * 8)).collect();
        // Header, its middle, the hash.
        let chosen = [0, 64, 800, 8 * bytes.len() - 1, 8 * bytes.len() - 100];
        for bit in anywhere.into_iter().chain(chosen) {
            bytes[bit / 8] ^= 1 << (bit % 8);
            std::fs::write(&checkpoint.path, &bytes).unwrap();
            assert!(matches!(checkpoint.load(&layout), Err(Unusable::Damaged(_))), "bit {bit}");
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
    }
}
