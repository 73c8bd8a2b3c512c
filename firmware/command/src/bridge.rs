//! A board's serial line as a TCP port of this machine, to which hosts come and go.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};

/// How long a host that reads nothing keeps the line waiting before bytes are thrown away.
const PATIENCE: Duration = Duration::from_millis(5);

/// Bytes that are taken from the line, or from a host, at once: what a pipe holds on Linux.
const CHUNK_BYTES: usize = 1 << 16;

/// Damage that a bridge does to a board's bytes on purpose, to test hosts: the places of the damaged bytes
/// among those that are sent to hosts, counted from 1.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Damage {
    /// Bytes that are left out.
    pub dropped: Vec<u64>,
    /// Bytes of which the lowest bit is changed.
    pub flipped: Vec<u64>,
}

impl Damage {
    /// Damages `bytes`, before which `count` bytes have come.
    fn apply(&self, bytes: &mut Vec<u8>, count: u64) {
        for (number, byte) in (count + 1..).zip(&mut *bytes) {
            *byte ^= u8::from(self.flipped.contains(&number));
        }
        let mut number = count;
        bytes.retain(|_| {
            number += 1;
            !self.dropped.contains(&number)
        });
    }
}

/// Event of the board at a bridge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It has sent its first byte.
    Spoke,
    /// It has ended.
    Ended,
}

/// A board's serial line at a TCP port. One host is served at a time, and one that comes takes the place
/// of the one before. Nothing waits for a host: what the board sends while there is none, or while it
/// does not read, is thrown away.
#[derive(Debug)]
pub struct Bridge {
    address: SocketAddr,
    events: Receiver<Event>,
    host: Host,
}

/// The host that is served.
type Host = Arc<Mutex<Option<TcpStream>>>;

impl Bridge {
    /// Listens at `address` for hosts, and carries what comes from the board to them and the reverse,
    /// until the board ends.
    ///
    /// # Errors
    /// Fails when the address cannot be listened at.
    pub fn open(
        address: SocketAddr,
        from_board: impl Read + Send + 'static,
        to_board: impl Write + Send + 'static,
        damage: Damage,
    ) -> Result<Self> {
        let listening = || format!("cannot listen at {address}");
        let listener = TcpListener::bind(address).with_context(listening)?;
        let address = listener.local_addr().with_context(listening)?;
        let host = Host::default();
        let (happens, events) = channel();
        let served = Arc::clone(&host);
        thread::spawn(move || send(from_board, &served, &damage, &happens));
        let served = Arc::clone(&host);
        thread::spawn(move || serve(&listener, &served, to_board));
        Ok(Self {
            address,
            events,
            host,
        })
    }

    /// Where hosts are served.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Waits for the next event of the board, for at most `longest`; `None` if there is none.
    #[must_use]
    pub fn next_event(&self, longest: Duration) -> Option<Event> {
        match self.events.recv_timeout(longest) {
            Ok(event) => Some(event),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(Event::Ended),
        }
    }
}

/// Lets go of the host that is served.
impl Drop for Bridge {
    fn drop(&mut self) {
        hang_up(&mut lock(&self.host));
    }
}

fn lock(host: &Host) -> MutexGuard<'_, Option<TcpStream>> {
    host.lock().unwrap_or_else(PoisonError::into_inner)
}

fn hang_up(host: &mut Option<TcpStream>) {
    if let Some(stream) = host.take() {
        // It fails where the other end has hung up already.
        let _ = stream.shutdown(Shutdown::Both);
    }
}

/// Carries the board's bytes to the host until the board ends.
fn send(mut board: impl Read, host: &Host, damage: &Damage, happens: &Sender<Event>) {
    let mut chunk = vec![0; CHUNK_BYTES];
    let (mut has_spoken, mut count) = (false, 0);
    loop {
        let length = match board.read(&mut chunk) {
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            Ok(0) | Err(_) => break,
            Ok(length) => length,
        };
        if !has_spoken {
            // Who has opened the bridge may look at it no more, here and below.
            let _ = happens.send(Event::Spoke);
            has_spoken = true;
        }
        let mut host = lock(host);
        let Some(stream) = host.as_mut() else {
            continue;
        };
        let mut bytes = chunk[..length].to_vec();
        damage.apply(&mut bytes, count);
        count += length as u64;
        match stream.write_all(&bytes) {
            Ok(()) => {}
            // The rest is thrown away.
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => hang_up(&mut host),
        }
    }
    hang_up(&mut lock(host));
    let _ = happens.send(Event::Ended);
}

/// Takes hosts, and carries what they send to the board.
fn serve(listener: &TcpListener, host: &Host, board: impl Write + Send + 'static) {
    let board = Arc::new(Mutex::new(board));
    for stream in listener.incoming() {
        let Ok(stream) = stream else { continue };
        // Messages are short, and each is to arrive at once.
        let set = stream
            .set_nodelay(true)
            .and_then(|()| stream.set_write_timeout(Some(PATIENCE)));
        let (Ok(()), Ok(reader)) = (set, stream.try_clone()) else {
            continue;
        };
        let mut served = lock(host);
        hang_up(&mut served);
        *served = Some(stream);
        drop(served);
        let board = Arc::clone(&board);
        thread::spawn(move || receive(reader, &board));
    }
}

/// Carries a host's bytes to the board, until the host sends no more.
fn receive(mut host: TcpStream, board: &Mutex<impl Write>) {
    let mut chunk = vec![0; CHUNK_BYTES];
    while let Ok(length @ 1..) = host.read(&mut chunk) {
        let mut board = board.lock().unwrap_or_else(PoisonError::into_inner);
        let written = board.write_all(&chunk[..length]);
        if written.and_then(|()| board.flush()).is_err() {
            break;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::PipeWriter;

    /// Long enough for what is to happen.
    const LONG: Duration = Duration::from_secs(20);

    /// A bridge with the board's ends of its line.
    fn bridge(damage: Damage) -> (Bridge, PipeWriter, impl Read) {
        let (from_board, board_out) = std::io::pipe().unwrap();
        let (board_in, to_board) = std::io::pipe().unwrap();
        let address = "127.0.0.1:0".parse().unwrap();
        let bridge = Bridge::open(address, from_board, to_board, damage).unwrap();
        (bridge, board_out, board_in)
    }

    /// A host that is served: what it sends has come to the board.
    fn host(bridge: &Bridge, board_in: &mut impl Read) -> TcpStream {
        let mut host = TcpStream::connect(bridge.address()).unwrap();
        host.set_read_timeout(Some(LONG)).unwrap();
        host.write_all(b"hello").unwrap();
        let mut heard = [0; 5];
        board_in.read_exact(&mut heard).unwrap();
        assert_eq!(&heard, b"hello");
        host
    }

    fn read<const N: usize>(mut stream: impl Read) -> [u8; N] {
        let mut bytes = [0; N];
        stream.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// Whether the other end has hung up, at once or with a byte that is still on its way.
    fn is_hung_up(mut stream: &TcpStream) -> bool {
        loop {
            match stream.read(&mut [0; 1]) {
                Ok(0) => return true,
                Ok(_) => {}
                Err(error) => return error.kind() == ErrorKind::ConnectionReset,
            }
        }
    }

    #[test]
    fn hosts_come_and_go_while_the_board_goes_on() {
        let (bridge, mut out, mut input) = bridge(Damage::default());
        assert_eq!(bridge.next_event(Duration::ZERO), None);
        // More than a pipe holds: it was read, or this would wait for ever.
        out.write_all(&vec![7; 1 << 20]).unwrap();
        assert_eq!(bridge.next_event(LONG), Some(Event::Spoke));
        // The last of it, which the pipe holds, is read and thrown away meanwhile.
        thread::sleep(Duration::from_millis(200));
        let first = host(&bridge, &mut input);
        // What was sent before nobody hears; a last chunk of it may be on its way.
        out.write_all(b"one").unwrap();
        let mut heard = vec![];
        while !heard.ends_with(b"one") {
            let [byte] = read(&first);
            heard.push(byte);
        }
        assert!(heard.len() <= 3 + CHUNK_BYTES);
        drop(first);
        out.write_all(&vec![8; 1 << 20]).unwrap();
        let second = host(&bridge, &mut input);
        // One that comes takes the place of one that is still there.
        let third = host(&bridge, &mut input);
        assert!(is_hung_up(&second));
        out.write_all(b"three").unwrap();
        let mut heard = vec![];
        while !heard.ends_with(b"three") {
            let [byte] = read(&third);
            heard.push(byte);
        }
        // The board ends, and its host is told.
        drop(out);
        assert!(is_hung_up(&third));
        assert_eq!(bridge.next_event(LONG), Some(Event::Ended));
        assert_eq!(bridge.next_event(LONG), Some(Event::Ended));
    }

    #[test]
    fn a_host_that_does_not_read_keeps_nothing_waiting() {
        let (bridge, mut out, mut input) = bridge(Damage::default());
        let _deaf = host(&bridge, &mut input);
        // More than all buffers between hold.
        out.write_all(&vec![0; 16 << 20]).unwrap();
    }

    #[test]
    fn bytes_are_damaged_where_they_are_to_be() {
        let damage = Damage {
            dropped: vec![2, 5],
            flipped: vec![3, 4],
        };
        let (bridge, mut out, mut input) = bridge(damage);
        let host = host(&bridge, &mut input);
        // In several pieces, whose bytes are counted on.
        for piece in [&[10, 20, 30][..], &[40], &[50, 60]] {
            out.write_all(piece).unwrap();
        }
        assert_eq!(read(&host), [10, 31, 41, 60]);
    }

    #[test]
    fn a_port_that_is_taken_is_refused() {
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = taken.local_addr().unwrap();
        let refused = Bridge::open(address, std::io::empty(), Vec::new(), Damage::default());
        let text = format!("{:#}", refused.unwrap_err());
        assert!(text.contains(&address.to_string()), "{text}");
    }
}
