//! Devices of Video4Linux. One thread per device receives its images.

use std::collections::VecDeque;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use depthloom_graphs::Fault;
use depthloom_threads::{locked, look_for_room};
use rustix::time::{ClockId, clock_gettime};
use v4l::buffer::{Flags, Metadata, Type};
use v4l::control::{Control, Value};
use v4l::io::mmap::Stream;
use v4l::io::traits::CaptureStream as _;
use v4l::video::Capture as _;
use v4l::video::capture::Parameters;
use v4l::{Device, FourCC};

use super::camera::V4l2Params;
use super::pairing::Captured;
use super::pixels::PixelFormat;

/// Images that wait per device; then the oldest is dropped.
const WAITING: usize = 4;
/// Buffers of the driver.
const BUFFERS: u32 = 4;
/// How often a thread looks whether it must stop, milliseconds.
const POLL_MS: i32 = 100;
const POLLIN: i16 = 1;
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_MANUAL: i64 = 1;
/// In units of 100 microseconds.
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;

/// An image as the device sent it.
pub(super) type RawImage = Captured<Vec<u8>>;

/// Images that have arrived and were not collected yet.
#[derive(Default)]
pub(super) struct Inbox {
    state: Mutex<Waiting>,
    arrived: Condvar,
}

#[derive(Default)]
struct Waiting {
    images: [VecDeque<RawImage>; 2],
    /// A device that has failed.
    error: Option<Fault>,
}

impl Inbox {
    /// Takes all images, after waiting for one until the deadline.
    pub(super) fn take(&self, deadline: Instant) -> Result<[VecDeque<RawImage>; 2], Fault> {
        let mut state = locked(&self.state);
        loop {
            if state.images.iter().any(|images| !images.is_empty()) {
                return Ok(std::mem::take(&mut state.images));
            }
            if let Some(error) = state.error.take() {
                return Err(error);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(Default::default());
            }
            state = self.arrived.wait_timeout(state, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn put(&self, camera: usize, image: RawImage) {
        let images = &mut locked(&self.state).images[camera];
        images.push_back(image);
        if images.len() > WAITING {
            // The gap of the driver's numbers shows it.
            images.pop_front();
        }
        self.arrived.notify_one();
    }

    fn fail(&self, error: Fault) {
        locked(&self.state).error.get_or_insert(error);
        self.arrived.notify_one();
    }
}

/// A device that sends images; dropping it stops the thread.
pub(super) struct Receiver {
    /// Bytes from one row to the next, for uncompressed formats.
    pub stride: u32,
    is_stopped: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Receiver {
    /// Opens a device, sets its format, and receives images into `inbox`.
    pub(super) fn start(path: &str, camera: usize, params: &V4l2Params, inbox: &Arc<Inbox>) -> Result<Self, Fault> {
        let failed = |what: &str, error: io::Error| Fault::new(format!("{path}: {what}")).because(error);
        let device = Device::with_path(path).map_err(|error| {
            failed("the device cannot be opened", error)
                .remedy("`v4l2-ctl --list-devices` lists devices; another program may use it")
        })?;
        let wanted = fourcc(params.format);
        let mut format = device.format().map_err(|error| failed("the device does not capture images", error))?;
        (format.width, format.height, format.fourcc) = (params.width, params.height, wanted);
        let format = device.set_format(&format).map_err(|error| failed("the format cannot be set", error))?;
        if (format.width, format.height, format.fourcc) != (params.width, params.height, wanted) {
            let what = format!(
                "{path}: the device offers {}x{} {} instead of {}x{} {wanted}",
                format.width, format.height, format.fourcc, params.width, params.height
            );
            let remedy = format!("`v4l2-ctl --device {path} --list-formats-ext` lists formats and sizes");
            return Err(Fault::new(what).remedy(remedy));
        }
        let rate = Parameters::with_fps(params.rate);
        device.set_params(&rate).map_err(|error| failed("the rate cannot be set", error))?;
        if let Some(exposure_ms) = params.exposure_ms {
            let exposure = (exposure_ms * 10.0).round().max(1.0) as i64;
            for (id, value) in [(EXPOSURE_AUTO, EXPOSURE_MANUAL), (EXPOSURE_ABSOLUTE, exposure)] {
                let control = Control { id, value: Value::Integer(value) };
                device
                    .set_control(control)
                    .map_err(|error| failed("the exposure cannot be set", error).remedy("remove `exposure_ms`"))?;
            }
        }
        let stream = Stream::with_buffers(&device, Type::VideoCapture, BUFFERS)
            .map_err(|error| failed("the device has no buffers", error).remedy("another program may use it"))?;
        let is_stopped = Arc::new(AtomicBool::new(false));
        let (stop, inbox, name) = (Arc::clone(&is_stopped), Arc::clone(inbox), path.to_owned());
        let receive = move || {
            // The device must outlive its stream.
            let _device = device;
            if let Err(error) = receive(stream, camera, &inbox, &stop) {
                inbox.fail(Fault::new(format!("{name}: the device sends no images any more")).because(error));
            }
        };
        let spawn = || {
            look_for_room()?;
            thread::Builder::new().name("depthloom-camera".to_owned()).spawn(receive)
        };
        let thread = spawn().map_err(|error| failed("no thread can be started", error))?;
        Ok(Self { stride: format.stride, is_stopped, thread: Some(thread) })
    }
}

impl Drop for Receiver {
    fn drop(&mut self) {
        self.is_stopped.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A thread that has panicked has stopped, too.
            let _ = thread.join();
        }
    }
}

fn fourcc(format: PixelFormat) -> FourCC {
    FourCC::new(match format {
        PixelFormat::Yuyv => b"YUYV",
        PixelFormat::Mjpg => b"MJPG",
        PixelFormat::Grey => b"GREY",
    })
}

fn receive(mut stream: Stream<'_>, camera: usize, inbox: &Inbox, is_stopped: &AtomicBool) -> io::Result<()> {
    let handle = stream.handle();
    let mut is_started = false;
    while !is_stopped.load(Ordering::Relaxed) {
        // `next` would block, and cannot be repeated after its time limit.
        if is_started && handle.poll(POLLIN, POLL_MS)? == 0 {
            continue;
        }
        is_started = true;
        let (bytes, metadata) = stream.next()?;
        if metadata.flags.contains(Flags::ERROR) {
            // The next image has a larger number.
            continue;
        }
        let used = bytes.get(..metadata.bytesused as usize).unwrap_or(bytes);
        inbox.put(camera, Captured { at: time_of(metadata), sequence: metadata.sequence, item: used.to_vec() });
    }
    Ok(())
}

/// The driver's time stamp, or the time of arrival if the driver uses another clock than the monotonic one.
fn time_of(metadata: &Metadata) -> Duration {
    if metadata.flags & Flags::TIMESTAMP_MASK != Flags::TIMESTAMP_MONOTONIC {
        return monotonic();
    }
    let seconds = u64::try_from(metadata.timestamp.sec).unwrap_or(0);
    Duration::from_secs(seconds) + Duration::from_micros(u64::try_from(metadata.timestamp.usec).unwrap_or(0))
}

pub(super) fn monotonic() -> Duration {
    let now = clock_gettime(ClockId::Monotonic);
    Duration::new(u64::try_from(now.tv_sec).unwrap_or(0), u32::try_from(now.tv_nsec).unwrap_or(0))
}
