//! Numbers and ids of a stream's frames, which stay unique when the program is started again.

use std::collections::HashSet;
use std::hash::{BuildHasher as _, RandomState};

use crate::process::source::check_id;

#[derive(Debug, Default)]
pub(super) struct Numbering {
    /// The number of the next frame if none is lost.
    next: u64,
    /// Added to the numbers that the current process states.
    offset: u64,
    /// Whether the current process has sent no frame yet.
    is_first: bool,
    /// Hashes of the ids that were stated.
    ids: HashSet<u64>,
    hasher: RandomState,
}

#[derive(Debug, PartialEq, Eq)]
pub(super) struct Numbered {
    pub id: String,
    pub index: u64,
    pub missed: u64,
}

impl Numbering {
    /// The next frame is the first one of a new process, which may count from 0 again.
    pub(super) fn restart(&mut self) {
        self.is_first = true;
        self.offset = 0;
    }

    /// A stated number decides how many frames were lost; without one, `missed` does.
    pub(super) fn next(&mut self, id: Option<String>, stated: Option<u64>, missed: u64) -> Result<Numbered, String> {
        let too_large = || format!("sent a frame whose number is too large: {stated:?}, {missed} missed");
        let by_count = self.next.checked_add(missed).ok_or_else(too_large)?;
        let index = match stated {
            None => by_count,
            Some(stated) => {
                if self.is_first && stated < self.next {
                    self.offset = by_count - stated;
                }
                let index = stated.checked_add(self.offset).ok_or_else(too_large)?;
                if index < self.next {
                    let last = (self.next - 1).saturating_sub(self.offset);
                    return Err(format!("sent frame {stated} after frame {last}, and numbers must increase"));
                }
                index
            }
        };
        // Numbers of a first frame do not start at 0 in all cameras.
        let missed = if self.next == 0 { missed } else { index - self.next };
        let after = index.checked_add(1).ok_or_else(too_large)?;
        let id = match id {
            None => format!("{index:06}"),
            Some(id) => {
                check_id(&id)?;
                if self.ids.insert(self.hasher.hash_one(&id)) { id } else { format!("{id}-{index}") }
            }
        };
        (self.next, self.is_first) = (after, false);
        Ok(Numbered { id, index, missed })
    }
}

#[cfg(test)]
mod tests {
    use super::{Numbered, Numbering};

    fn numbered(id: &str, index: u64, missed: u64) -> Result<Numbered, String> {
        Ok(Numbered { id: id.to_owned(), index, missed })
    }

    #[test]
    fn frames_without_a_number_are_counted_and_missed_frames_count() {
        let mut numbering = Numbering::default();
        numbering.restart();
        assert_eq!(numbering.next(None, None, 0), numbered("000000", 0, 0));
        assert_eq!(numbering.next(None, None, 3), numbered("000004", 4, 3));
        numbering.restart();
        assert_eq!(numbering.next(None, None, 0), numbered("000005", 5, 0));
    }

    #[test]
    fn gaps_of_stated_numbers_are_missed_frames() {
        let mut numbering = Numbering::default();
        numbering.restart();
        assert_eq!(numbering.next(None, Some(1000), 0), numbered("001000", 1000, 0));
        assert_eq!(numbering.next(None, Some(1003), 0), numbered("001003", 1003, 2));
        let what = "sent frame 1003 after frame 1003, and numbers must increase";
        assert_eq!(numbering.next(None, Some(1003), 0), Err(what.to_owned()));
        assert!(numbering.next(None, Some(u64::MAX), 0).unwrap_err().contains("too large"));
        assert!(numbering.next(None, None, u64::MAX).unwrap_err().contains("too large"));
    }

    #[test]
    fn numbers_continue_after_a_restart() {
        let mut numbering = Numbering::default();
        numbering.restart();
        assert_eq!(numbering.next(None, Some(0), 0), numbered("000000", 0, 0));
        assert_eq!(numbering.next(None, Some(1), 0), numbered("000001", 1, 0));
        numbering.restart();
        assert_eq!(numbering.next(None, Some(0), 0), numbered("000002", 2, 0), "it counts from 0 again");
        assert_eq!(numbering.next(None, Some(2), 0), numbered("000004", 4, 1));
        let what = numbering.next(None, Some(1), 0).unwrap_err();
        assert_eq!(what, "sent frame 1 after frame 2, and numbers must increase");
        numbering.restart();
        assert_eq!(numbering.next(None, Some(9), 0), numbered("000009", 9, 4), "a counter of the device");
    }

    #[test]
    fn ids_are_unique_and_checked() {
        let mut numbering = Numbering::default();
        let mut next = |id: &str| numbering.next(Some(id.to_owned()), None, 0);
        assert_eq!(next("a"), numbered("a", 0, 0));
        assert_eq!(next("b"), numbered("b", 1, 0));
        assert_eq!(next("a"), numbered("a-2", 2, 0));
        assert_eq!(next("").unwrap_err(), "\"\" is not a valid id: one line of at most 200 bytes");
    }
}
