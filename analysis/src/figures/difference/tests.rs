use super::*;

#[test]
fn long_names_are_shortened_to_their_differences() {
    let long = ["size=3+weighting=full/fused", "size=5+weighting=full/fused"];
    assert_eq!(distinguished(long), ["size=3", "size=5"]);
    assert_eq!(distinguished(["stereo", "full/mono"]), ["stereo", "full/mono"]);
    let other = ["stereo", "a=1+b=2+c=3+d=4+e=5+f=6/fused"];
    assert_eq!(distinguished(other), other);
    assert_eq!(distinguished(["weighting=full/mono_scaled", "weighting=full/fused"]), ["mono_scaled", "fused"]);
}
