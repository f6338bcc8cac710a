//! Brightness and colour difference (`uyvy`, `yuyv`, `nv21`) as red, green and blue: ITU-R BT.601 with footroom, in the
//! fixed point of OpenCV's `cvtColor`.
//! <https://docs.opencv.org/4.x/de/d25/imgproc_color_conversions.html#color_convert_rgb_yuv_42x>

const SHIFT: u32 = 20;
/// 1.164, 2.018, -0.391, -0.813 and 1.596.
const BRIGHTNESS: i32 = 1_220_542;
const BLUE_OF_U: i32 = 2_116_026;
const GREEN_OF_U: i32 = -409_993;
const GREEN_OF_V: i32 = -852_492;
const RED_OF_V: i32 = 1_673_527;

/// How two pixels share their colour difference in four bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Packed {
    /// U, brightness, V, brightness.
    Uyvy,
    /// Brightness, U, brightness, V.
    Yuyv,
}

impl Packed {
    /// The order that an encoding of ROS 2 or Foxglove names; `None` if it names none.
    pub(crate) fn named(encoding: &str) -> Option<Self> {
        match encoding {
            "uyvy" | "yuv422" => Some(Self::Uyvy),
            "yuyv" | "yuv422_yuy2" => Some(Self::Yuyv),
            _ => None,
        }
    }

    pub(crate) fn colours(self, bytes: [u8; 4]) -> [[u8; 3]; 2] {
        let [u, first, v, second] = match self {
            Self::Uyvy => bytes,
            Self::Yuyv => [bytes[1], bytes[0], bytes[3], bytes[2]],
        };
        [colour(first, u, v), colour(second, u, v)]
    }
}

pub(crate) fn colour(brightness: u8, u: u8, v: u8) -> [u8; 3] {
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    let brightness = (i32::from(brightness) - 16).max(0) * BRIGHTNESS;
    let half = 1 << (SHIFT - 1);
    [RED_OF_V * v, GREEN_OF_V * v + GREEN_OF_U * u, BLUE_OF_U * u]
        .map(|difference| ((brightness + difference + half) >> SHIFT).clamp(0, 255) as u8)
}
