//! `vgstereo view`: a page in the browser that shows a stereo camera live.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread;

use anyhow::Result;
use clap::Args;

use crate::arguments::SourceOptions;
use crate::cameras::SeenWith;
use crate::terminal::write_output;
use crate::view::hub::Hub;
use crate::view::reader::Reader;
use crate::view::server;

/// The arguments of `vgstereo view`.
#[derive(Debug, Args)]
#[command(
    after_help = "The page is at the address that is printed, for this machine alone.\n\n\
    A serial port:     vgstereo view /dev/ttyACM0\n\
    A board over TCP:  vgstereo view 192.168.7.2:7000\n\
    A recording:       vgstereo view recording.mcap\n\
    No board at all:   vgstereo view --demo"
)]
pub struct View {
    #[command(flatten)]
    source: SourceOptions,
    /// Read a file as fast as can be, rather than at the pace that its bytes were sent at.
    #[arg(long)]
    fast: bool,
    /// Address of the page on this machine; port 0 takes a free one.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8008")]
    listen: SocketAddr,
    #[command(flatten)]
    seen_with: SeenWith,
}

impl View {
    /// Opens the source and serves the page until the process ends.
    ///
    /// # Errors
    /// Fails with one line that names the option or source and the reason.
    pub fn run(self) -> Result<String> {
        let source = self.source.source(self.fast)?;
        let calibrated = self.seen_with.camera()?;
        let listener = server::listen(self.listen)?;
        let port = source.open()?;
        let (hub, requests) = Hub::new();
        let hub = Arc::new(hub);
        let reader = Reader::new(&source, Arc::clone(&hub), requests, calibrated);
        thread::Builder::new()
            .name("reader".to_owned())
            .spawn(move || reader.run(&source, port))?;
        write_output(format!("view http://{}/\n", listener.local_addr()?).as_bytes())?;
        server::serve(listener, hub)?;
        Ok(String::new())
    }
}
