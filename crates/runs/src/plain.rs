//! File names made from arbitrary text.

/// The longest name without its extension, bytes: every file system accepts it, with the suffix of unfinished files.
const LONGEST: usize = 200;

/// A text as a name that every file system accepts: other characters become `_`, and so do names of dots only, which
/// would be another folder.
pub fn file_name(text: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_.=,+".contains(c);
    let is_name = text.contains(|c: char| c != '.');
    let mut name: String = text.chars().map(|c| if is_plain(c) && is_name { c } else { '_' }).collect();
    name.truncate(name.floor_char_boundary(LONGEST));
    if name.is_empty() { "_".to_owned() } else { name }
}

#[cfg(test)]
mod tests {
    use super::file_name;

    #[test]
    fn no_name_leads_to_another_folder() {
        let names = ["000150_10", "block=3+p1=8.5", "a/b\\c:d", "..", ".", "", "größe 1", "..x"];
        let plain = ["000150_10", "block=3+p1=8.5", "a_b_c_d", "__", "_", "_", "größe_1", "..x"];
        assert_eq!(names.map(file_name), plain);
        assert_eq!(file_name(&"ö".repeat(200)).len(), 200);
    }
}
