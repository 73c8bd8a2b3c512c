//! `vgstereo view`: what is refused before anything is served.

use std::fs;
use std::net::TcpListener;

use crate::fixture::Fixture;

#[test]
fn sources_and_addresses_that_are_none_are_refused() {
    let fixture = Fixture::new();
    fs::write(fixture.path("recording.bin"), [0]).unwrap();
    let refuses = |arguments: &[&str], words: &[&str]| {
        fixture.refuses(&[&["view"][..], arguments].concat(), words);
    };
    refuses(&[], &["HOST:PORT", "--demo", "serial port"]);
    refuses(&["nowhere"], &["nowhere", "no such file"]);
    refuses(&["."], &[".", "folder"]);
    refuses(&["/dev/vgstereo-none"], &["/dev/vgstereo-none"]);
    let closed = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap();
    refuses(&[&closed.to_string()], &[&closed.to_string(), "refused"]);
    for address in ["0.0.0.0:0", "192.0.2.1:8008", "[::]:0"] {
        refuses(
            &["recording.bin", "--listen", address],
            &["--listen", address, "127.0.0.1"],
        );
    }
    refuses(&["recording.bin", "--listen", "localhost"], &["--listen"]);
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let taken = taken.local_addr().unwrap().to_string();
    refuses(
        &["recording.bin", "--listen", &taken],
        &["--listen", &taken],
    );
    refuses(&["recording.bin", "--demo"], &["--demo"]);
    refuses(&["--demo", "--calibration", "left.png"], &["left.png"]);
    refuses(
        &["recording.bin", "--unit", "mm"],
        &["--unit", "--calibration"],
    );
    // What the command that builds the board has to say stands before.
    let outcome = fixture.run(&["view", "--board", "no-such-board"]);
    assert_eq!(outcome.code, Some(2), "{}", outcome.stderr);
    let last = outcome.stderr.lines().last().unwrap();
    assert!(
        last.starts_with("error: cargo firmware live --board no-such-board"),
        "{last}"
    );
}
