//! Names in the order that people expect.

use std::cmp::Ordering;

/// The order of names in which numbers count by their value: `9` before `10`.
pub fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let (Some(x), Some(y)) = (a.chars().next(), b.chars().next()) else { return a.len().cmp(&b.len()) };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            let ((left, rest_a), (right, rest_b)) = (a.split_at(digits(a)), b.split_at(digits(b)));
            let (short, other) = (left.trim_start_matches('0'), right.trim_start_matches('0'));
            let order = short.len().cmp(&other.len()).then_with(|| short.cmp(other)).then_with(|| left.cmp(right));
            if order.is_ne() {
                return order;
            }
            (a, b) = (rest_a, rest_b);
        } else if x == y {
            (a, b) = (&a[x.len_utf8()..], &b[y.len_utf8()..]);
        } else {
            return x.cmp(&y);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::natural_order;

    #[test]
    fn numbers_in_names_are_in_order() {
        let mut names = ["b", "a10", "a9", "a09", "a", "a1b", "a1"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["a", "a1", "a1b", "a09", "a9", "a10", "b"]);
    }
}
