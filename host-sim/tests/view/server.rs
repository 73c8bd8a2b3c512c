//! Who is served, and what one client can do to others.

use std::time::{Duration, Instant};

use crate::fixture::{Served, WAIT};

#[test]
fn the_page_and_all_its_files_are_served_with_a_strict_policy() {
    let served = Served::new();
    let mut paths = vec!["/".to_owned()];
    let mut at = 0;
    while let Some(path) = paths.get(at).cloned() {
        at += 1;
        let answer = served.page(&path);
        assert!(answer.starts_with("HTTP/1.1 200"), "{path}: {answer}");
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        for line in [
            "content-security-policy: default-src 'none'; script-src 'self'; style-src 'self'",
            "frame-ancestors 'none'",
            "x-content-type-options: nosniff",
            "cross-origin-resource-policy: same-origin",
        ] {
            assert!(head.contains(line), "{path}: {head}");
        }
        // What a file names: sources, links, imports. Nothing is of another place.
        assert!(
            !body.contains("//cdn") && !body.contains("https://"),
            "{path}"
        );
        for mark in ["src=\"", "href=\"", "from \"./"] {
            for part in body.split(mark).skip(1) {
                let name = format!("/{}", part.split('"').next().unwrap());
                if !paths.contains(&name) {
                    paths.push(name);
                }
            }
        }
        // The policy lets no script or style within the page run.
        assert!(
            !body.contains("<style") && !body.contains("<script>"),
            "{path}"
        );
    }
    assert!(paths.len() > 5, "{paths:?}");
    let colours = served.page("/colours");
    assert!(colours.contains("content-length: 768"), "{colours}");
    assert!(served.page("/none").starts_with("HTTP/1.1 404"));
}

#[test]
fn requests_to_other_hosts_are_refused() {
    let served = Served::new();
    let port = served.address.port();
    let status = |path: &str, head: &[&str]| served.get(path, head)[9..12].to_owned();
    for host in [
        "127.0.0.1",
        "localhost",
        "LOCALHOST:1",
        "[::1]:8008",
        "127.3.2.1",
    ] {
        assert_eq!(status("/", &[&format!("Host: {host}")]), "200", "{host}");
    }
    for host in [
        "example.org",
        &format!("example.org:{port}"),
        "127.0.0.1.example.org",
        "localhost.example.org",
        "192.168.0.1",
        "0.0.0.0",
        "x@127.0.0.1",
        "[::2]",
        "",
    ] {
        for path in ["/", "/live", "/colours", "/main.js"] {
            assert_eq!(status(path, &[&format!("Host: {host}")]), "403", "{host}");
        }
    }
    assert_eq!(
        status("/", &["Host: 127.0.0.1", "Host: example.org"]),
        "403"
    );
}

#[test]
fn connections_from_other_pages_are_refused() {
    let served = Served::new();
    let own = format!("http://{}", served.address);
    assert!(served.client(Some(&own)).is_ok());
    assert!(served.client(None).is_ok());
    for origin in [
        "http://example.org",
        "null",
        &format!("https://{}", served.address),
        &format!("http://{}0", served.address),
        "http://127.0.0.1:1",
        &format!("http://localhost:{}", served.address.port()),
        &format!("{own}/"),
    ] {
        assert_eq!(served.client(Some(origin)).err(), Some(403), "{origin}");
    }
}

#[test]
fn addresses_that_others_could_reach_are_refused() {
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:8008"] {
        let error = vgstereo_sim::view::server::listen(address.parse().unwrap()).unwrap_err();
        assert!(error.to_string().starts_with("--listen"), "{error}");
    }
}

#[test]
fn a_client_that_sends_no_requests_is_left_alone_and_others_are_not() {
    let served = Served::new();
    let mut other = served.client(None).unwrap();
    let long = format!(r#"{{"show":["raw"{}]}}"#, " ".repeat(5000));
    for garbage in ["", "no request", r#"{"board":"commit"}"#, &long] {
        let mut client = served.client(None).unwrap();
        client.send(garbage);
        assert_eq!(client.frame(), None, "{garbage:.20}");
    }
    let mut client = served.client(None).unwrap();
    client
        .0
        .send(tungstenite::Message::binary(vec![7; 40]))
        .unwrap();
    assert_eq!(client.frame(), None);
    served.hub.publish_frame(vec![1, 2, 3]);
    assert_eq!(other.frame(), Some(vec![1, 2, 3]));
}

/// Memory of this process, bytes.
#[cfg(target_os = "linux")]
fn memory_bytes() -> usize {
    let pages = std::fs::read_to_string("/proc/self/statm").unwrap();
    pages.split(' ').nth(1).unwrap().parse::<usize>().unwrap() * 4096
}

#[test]
fn a_client_that_does_not_read_delays_no_one_and_takes_no_memory() {
    const FRAMES: u64 = 150;
    const BYTES: usize = 4 << 20;
    let served = Served::new();
    let mut slow = served.client(None).unwrap();
    let mut quick = served.client(None).unwrap();
    #[cfg(target_os = "linux")]
    let before = memory_bytes();
    let mut delays = vec![];
    for number in 1..=FRAMES {
        let mut frame = vec![0; BYTES];
        frame[..8].copy_from_slice(&number.to_le_bytes());
        served.hub.publish_frame(frame);
        let published = Instant::now();
        let got = quick.frame().unwrap();
        delays.push(published.elapsed());
        assert_eq!(got[..8], number.to_le_bytes());
    }
    delays.sort();
    let median = delays[delays.len() / 2];
    assert!(median < Duration::from_millis(500), "{median:?}");
    // 600 MiB were published; a few frames are kept.
    #[cfg(target_os = "linux")]
    {
        let grown = memory_bytes().saturating_sub(before);
        assert!(grown < 20 * BYTES, "{grown} bytes more");
    }
    // What it gets when it reads at last: what was on its way, then the newest at once.
    let mut numbers = vec![];
    let started = Instant::now();
    while numbers.last() != Some(&FRAMES) && started.elapsed() < WAIT {
        let frame = slow.frame().unwrap();
        numbers.push(u64::from_le_bytes(frame[..8].try_into().unwrap()));
    }
    assert!(
        numbers.len() <= 3 && numbers.last() == Some(&FRAMES),
        "{numbers:?}"
    );
}
