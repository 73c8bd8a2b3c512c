//! What stands between the thread that reads the board and those who look: the newest frame and
//! status, what is shown to whom, and commands on their way.
//!
//! Nothing here grows with time or with how slow a client is: a frame takes the place of one that
//! was not yet fetched.

use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Mutex, MutexGuard, PoisonError};

use axum::body::Bytes;
use axum::extract::ws::Utf8Bytes;
use tokio::sync::watch;

use super::request::{Command, Show};

/// Largest number of clients.
pub const CLIENTS_MAX: usize = 16;

/// Commands that may wait for the board.
const COMMANDS_MAX: usize = 16;

/// The place where reader and clients meet.
#[derive(Debug)]
pub struct Hub {
    frame: watch::Sender<Bytes>,
    status: watch::Sender<Utf8Bytes>,
    commands: SyncSender<Command>,
    clients: Mutex<Clients>,
}

#[derive(Debug, Default)]
struct Clients {
    next: u64,
    shown: BTreeMap<u64, Show>,
}

/// A client's place at a [`Hub`], until it is dropped.
#[derive(Debug)]
pub struct Seat<'h> {
    hub: &'h Hub,
    number: u64,
    /// The newest frame, a message of [`snapshot`](super::snapshot); empty before the first.
    pub frame: watch::Receiver<Bytes>,
    /// The newest [`Status`](super::status::Status), in JSON; empty before the first.
    pub status: watch::Receiver<Utf8Bytes>,
}

impl Hub {
    /// A hub, and the end at which commands come out.
    #[must_use]
    pub fn new() -> (Self, Receiver<Command>) {
        let (commands, receiver) = sync_channel(COMMANDS_MAX);
        let hub = Self {
            frame: watch::Sender::new(Bytes::new()),
            status: watch::Sender::new(Utf8Bytes::default()),
            commands,
            clients: Mutex::default(),
        };
        (hub, receiver)
    }

    /// Puts a frame in the place of the one before.
    pub fn publish_frame(&self, message: Vec<u8>) {
        self.frame.send_replace(message.into());
    }

    /// Puts a status in the place of the one before.
    pub fn publish_status(&self, json: String) {
        self.status.send_replace(json.into());
    }

    /// What is shown, to all clients together.
    #[must_use]
    pub fn shown(&self) -> Show {
        let clients = self.clients();
        clients
            .shown
            .values()
            .fold(Show::default(), |all, show| all.with(*show))
    }

    /// A place for one more client, to which nothing is shown yet; `None` when there are
    /// [`CLIENTS_MAX`].
    #[must_use]
    pub fn join(&self) -> Option<Seat<'_>> {
        let mut clients = self.clients();
        if clients.shown.len() >= CLIENTS_MAX {
            return None;
        }
        let number = clients.next;
        clients.next += 1;
        clients.shown.insert(number, Show::default());
        drop(clients);
        Some(Seat {
            hub: self,
            number,
            frame: self.frame.subscribe(),
            status: self.status.subscribe(),
        })
    }

    fn clients(&self) -> MutexGuard<'_, Clients> {
        // What is in there holds at any time.
        self.clients.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Seat<'_> {
    /// Shows this to the client, and no longer what it was shown before.
    pub fn show(&self, show: Show) {
        self.hub.clients().shown.insert(self.number, show);
    }

    /// Hands a command on. Returns whether there was room for it.
    #[must_use]
    pub fn command(&self, command: Command) -> bool {
        !matches!(
            self.hub.commands.try_send(command),
            Err(TrySendError::Full(_))
        )
    }
}

impl Drop for Seat<'_> {
    fn drop(&mut self) {
        self.hub.clients().shown.remove(&self.number);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::request::Shown;

    #[test]
    fn what_is_shown_is_the_union_of_who_is_there() {
        let (hub, _commands) = Hub::new();
        let show = |shown| [shown].into_iter().collect::<Show>();
        let one = hub.join().unwrap();
        let other = hub.join().unwrap();
        one.show(show(Shown::Raw));
        other.show(show(Shown::Depth));
        assert_eq!(hub.shown(), show(Shown::Raw).with(show(Shown::Depth)));
        one.show(show(Shown::Scan));
        assert_eq!(hub.shown(), show(Shown::Scan).with(show(Shown::Depth)));
        drop(other);
        assert_eq!(hub.shown(), show(Shown::Scan));
        drop(one);
        assert_eq!(hub.shown(), Show::default());
    }

    #[test]
    fn clients_and_commands_are_bounded() {
        let (hub, commands) = Hub::new();
        let seats: Vec<_> = (0..CLIENTS_MAX).map(|_| hub.join().unwrap()).collect();
        assert!(hub.join().is_none());
        let sent = (0..100)
            .filter(|_| seats[0].command(Command::Start))
            .count();
        assert_eq!(sent, COMMANDS_MAX);
        assert_eq!(commands.try_iter().count(), COMMANDS_MAX);
        drop(seats);
        assert!(hub.join().is_some());
    }

    #[test]
    fn the_newest_frame_takes_the_place_of_one_that_was_not_fetched() {
        let (hub, _commands) = Hub::new();
        let mut seat = hub.join().unwrap();
        for number in 0..100 {
            hub.publish_frame(vec![number]);
        }
        assert_eq!(seat.frame.borrow_and_update()[..], [99]);
        assert!(!seat.frame.has_changed().unwrap());
    }
}
