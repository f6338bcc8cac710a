//! What prevents a viewer from starting is reported before the run.

use depthloom_viewer::{ServeAddress, Viewer};

#[expect(dead_code, reason = "only the plan is needed")]
#[path = "../../../recording/tests/recording/fixture.rs"]
mod fixture;

fn start_error(address: ServeAddress, topics: &[&str]) -> depthloom_graphs::ErrorMessage {
    let topics: Vec<String> = topics.iter().map(|&topic| topic.to_owned()).collect();
    let Err(error) = Viewer::start(&fixture::plan(), address, &topics, "test") else { panic!("it started") };
    error
}

fn any_port() -> ServeAddress {
    ServeAddress::parse("127.0.0.1:0").expect("an address")
}

#[test]
fn a_pattern_without_topics_is_reported_with_the_topics() {
    let error = start_error(any_port(), &["*/depth", "*/dept"]);
    assert_eq!(error.to_string(), "no topic matches `*/dept`");
    let remedy = error.remedy.unwrap();
    for topic in ["/compare/source/left/image", "/compare/fused/depth", "/compare/view/fused.depth"] {
        assert!(remedy.contains(topic), "{remedy}");
    }
}

#[cfg(not(feature = "serve"))]
#[test]
fn a_build_without_the_server_says_how_to_build_it() {
    let error = start_error(any_port(), &[]);
    assert_eq!(error.to_string(), "this build of depthloom has no server: it lacks the feature `serve`");
    assert!(error.remedy.unwrap().contains("--features serve"));
}

#[cfg(feature = "serve")]
#[test]
fn an_address_in_use_is_reported() {
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap();
    let error = start_error(ServeAddress::parse(&address.to_string()).unwrap(), &[]);
    assert_eq!(error.to_string(), format!("failed to serve at {address}"));
    assert!(error.source.unwrap().to_string().to_lowercase().contains("in use"));
    assert!(error.remedy.unwrap().contains("choose another one with --serve"));
}
