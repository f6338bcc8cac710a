//! Whether two images are a left and a right one at all.

use depthloom_graphs::values::Image;

use super::reduced::{HALF, Reduced, contrast};
use super::votes::{ACROSS, LARGEST, STEP, Votes, has_texture};
use super::{Contradiction, FEWEST};
use depthloom_nodes::grey::grey;

/// Grey levels: an image with a smaller range shows nothing.
const FLAT: u8 = 2;

/// Returns the contradictions of a pair; without any, the places that both images show.
pub(super) fn faults(left: &Image, right: &Image) -> (Vec<Contradiction>, Option<Votes>) {
    let of_one = [("left", left), ("right", right)].into_iter().filter_map(|(port, image)| flat(port, image));
    let found: Vec<Contradiction> = of_one.collect();
    if !found.is_empty() || left.dimensions() != right.dimensions() {
        return (found, None);
    }
    let factor = (left.dimensions().0 as usize).div_ceil(ACROSS).max(1);
    if grey(left) == grey(right) {
        let what = "left and right are one picture, equal in every pixel".to_owned();
        let remedy = "one of the two was written in place of the other: take it from where it came from";
        return (vec![Contradiction { port: "right", what, remedy }], None);
    }
    let (left, right) = (Reduced::new(left, factor), Reduced::new(right, factor));
    let votes = Votes::collect(&left, &right, factor);
    // Two different scenes match by chance, also on the wrong side.
    let fault = Rows::find(&left, &right).fault(&left, &right, factor).or_else(|| exchanged(&votes));
    match fault {
        Some(fault) => (vec![fault], None),
        None => (Vec::new(), Some(votes)),
    }
}

fn flat(port: &'static str, image: &Image) -> Option<Contradiction> {
    let grey = grey(image);
    let (least, most) = grey.iter().fold((u8::MAX, u8::MIN), |(least, most), of| (least.min(*of), most.max(*of)));
    (most.saturating_sub(least) <= FLAT).then(|| Contradiction {
        port,
        what: format!("the image shows nothing: its pixels are all of grey level {least}{}", if most > least { " or about" } else { "" }),
        remedy: "a camera was covered or off, or the file was written wrong: take it from where it came from, or the frame out (`frames:`)",
    })
}

fn exchanged(votes: &Votes) -> Option<Contradiction> {
    votes.are_for_exchange().then(|| Contradiction {
        port: "right",
        what: format!(
            "left and right look exchanged: {} places of the left image are found further right in the other, {} further left",
            votes.wrong,
            votes.right.len()
        ),
        remedy: "a point lies further left in the right image than in the left one: exchange the two, or the cameras in the calibration",
    })
}

const ROWS: isize = 3;
const PLACES: usize = 2 * FEWEST;
/// Largest share of a block's contrast that may remain where the block counts as found.
const FOUND: f64 = 0.5;

/// Places with texture: column, row, remaining contrast in the same row, in the best other row, and that row's offset.
struct Rows(Vec<(usize, usize, f64, f64, isize)>);

impl Rows {
    fn find(left: &Reduced, right: &Reduced) -> Self {
        let most = left.width / LARGEST;
        let margin = HALF + ROWS as usize;
        let rows = (margin..left.height.saturating_sub(margin)).step_by(2 * STEP);
        let columns = (HALF + most..left.width.saturating_sub(HALF + most)).step_by(2 * STEP);
        let places = rows.flat_map(|row| columns.clone().map(move |column| (column, row)));
        let one = |(column, row): (usize, usize)| {
            let block = left.block(column, row);
            if !has_texture(&block) {
                return None;
            }
            let contrast = f64::from(contrast(&block).max(1));
            let best = |by: isize| {
                let row = row.saturating_add_signed(by);
                let apart = (column - most..=column + most).map(|at| right.apart_but_for_means(&block, at, row)).min();
                f64::from(apart.unwrap_or(u32::MAX)) / contrast
            };
            let others = (1..=ROWS).flat_map(|by| [by, -by]).map(|by| (best(by), by));
            let (other, by) = others.min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some((column, row, best(0), other, by))
        };
        Self(places.filter_map(one).collect())
    }

    fn fault(&self, left: &Reduced, right: &Reduced, factor: usize) -> Option<Contradiction> {
        let count = self.0.len();
        if count < PLACES {
            return None;
        }
        let mut beside: Vec<usize> =
            self.0.iter().filter(|of| of.3 < FOUND && of.3 < 0.7 * of.2).map(|of| of.4.unsigned_abs()).collect();
        if 2 * beside.len() > count {
            let number = beside.len();
            let by = *beside.select_nth_unstable(number / 2).1 * factor;
            return Some(Contradiction {
                port: "right",
                what: format!(
                    "left and right are not rectified: {number} of {count} places are found about {by} px above or below their row, and not in it"
                ),
                remedy: "rectify them, or set a calibration that rectifies them (`depthloom nodes images`); if they are rectified, check whether one was cropped or scaled differently",
            });
        }
        let found = self.0.iter().filter(|of| of.2.min(of.3) < FOUND).count();
        if 4 * found >= count {
            return None;
        }
        // Near objects may be farther away: search the whole row.
        let anywhere = self.0.iter().filter(|(column, row, ..)| {
            let block = left.block(*column, *row);
            let columns = HALF..right.width.saturating_sub(HALF);
            let best = columns.map(|at| right.apart_but_for_means(&block, at, *row)).min();
            best.is_some_and(|best| f64::from(best) < FOUND * f64::from(contrast(&block)))
        });
        let found = found.max(anywhere.count());
        (3 * found < count).then(|| Contradiction {
            port: "right",
            what: format!(
                "left and right do not show the same: of {count} places with texture {found} are found along their rows"
            ),
            remedy: "do the two files belong to one moment, and to one pair of cameras? is the pair rectified?",
        })
    }
}
