//! A recording of a board: the bytes of its link as they came, with the times at which they came.
//!
//! The file is an [MCAP](https://mcap.dev) file with one channel, whose messages are what each read from
//! the board gave, unchanged. It has no chunks: a file that is cut anywhere is whole up to the last record
//! that is. Records count from 0 and state their time twice, so that a damaged head of one does not pass
//! for another; the bytes themselves have the checksums of the link.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::io::{BufReader, BufWriter, ErrorKind, Read, Seek, Write};
use std::path::Path;

use anyhow::{Context, Result, ensure};
use mcap::records::{MessageHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{McapError, WriteOptions, Writer};

use crate::escapes::shown;

/// The encoding of the channel's messages: bytes of the link.
pub const ENCODING: &str = "vgstereo-link";
/// The topic of the channel.
const TOPIC: &str = "/link";
/// The program that an MCAP file names as its writer.
pub(super) const LIBRARY: &str = concat!("vgstereo ", env!("CARGO_PKG_VERSION"));
/// Longest record that is read. Those that are written have what one read from a board gives.
const RECORD_BYTES_MAX: usize = 1 << 20;

/// Whether a file that begins with these bytes is an MCAP file, or was one before it was cut.
#[must_use]
pub fn is_mcap(head: &[u8]) -> bool {
    let length = head.len().min(mcap::MAGIC.len());
    length > 0 && head.get(..length) == mcap::MAGIC.get(..length)
}

/// Writes a recording. What was pushed is in the file, even if the process ends before it is finished.
pub struct Recorder<W: Write + Seek> {
    writer: Writer<BufWriter<W>>,
    channel: u16,
    records: u64,
    bytes: u64,
}

impl<W: Write + Seek> fmt::Debug for Recorder<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recorder")
            .field("records", &self.records)
            .field("bytes", &self.bytes)
            .finish_non_exhaustive()
    }
}

impl Recorder<File> {
    /// A recording in a new file.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason: above all if it is there already.
    pub fn create(path: &Path) -> Result<Self> {
        let file =
            File::create_new(path).with_context(|| format!("cannot write {}", shown(path)))?;
        Self::new(file).with_context(|| format!("cannot write {}", shown(path)))
    }
}

impl<W: Write + Seek> Recorder<W> {
    /// A recording that is written there.
    ///
    /// # Errors
    /// Fails when it cannot be written.
    pub fn new(output: W) -> Result<Self> {
        let options = WriteOptions::new()
            .compression(None)
            .use_chunks(false)
            .library(LIBRARY);
        let mut writer = options.create(BufWriter::new(output))?;
        let version = ("version".to_owned(), vgstereo_link::VERSION.to_string());
        let channel = writer.add_channel(0, TOPIC, ENCODING, &BTreeMap::from([version]))?;
        writer.flush()?;
        Ok(Self {
            writer,
            channel,
            records: 0,
            bytes: 0,
        })
    }

    /// Adds bytes that came at this time, ns since 1970.
    ///
    /// # Errors
    /// Fails when they cannot be written.
    pub fn push(&mut self, arrived_ns: u64, bytes: &[u8]) -> Result<()> {
        let header = MessageHeader {
            channel_id: self.channel,
            // Wraps, as the reader expects.
            sequence: self.records as u32,
            log_time: arrived_ns,
            publish_time: arrived_ns,
        };
        self.writer.write_to_known_channel(&header, bytes)?;
        self.writer.flush()?;
        self.records += 1;
        self.bytes += bytes.len() as u64;
        Ok(())
    }

    /// Number of records that were pushed.
    #[must_use]
    pub fn records(&self) -> u64 {
        self.records
    }

    /// Number of bytes of the link that were pushed.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Ends the file, with a checksum over all of it, and returns what it was written to.
    ///
    /// # Errors
    /// Fails when that cannot be written.
    pub fn finish(mut self) -> Result<W> {
        self.writer.finish()?;
        let output = self.writer.into_inner().into_inner();
        output.map_err(|error| error.into_error().into())
    }
}

/// Where a recording is no longer whole, and why.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Bytes of the file up to the end of the last whole record.
    pub bytes: u64,
    /// Number of whole records with bytes of the link.
    pub records: u64,
    /// What is wrong after them.
    pub reason: String,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            bytes,
            records,
            reason,
        } = self;
        write!(f, "read up to byte {bytes}, {records} records: {reason}")
    }
}

/// Reads a recording, record by record.
pub struct Recording<R> {
    input: R,
    reader: LinearReader,
    /// The channel of the link's bytes, once it was found.
    channel: Option<u16>,
    /// Bytes of the record under way, and how many of them [`Recording::read`] has given.
    payload: Vec<u8>,
    given: usize,
    arrived_ns: Option<u64>,
    /// The number that the next record must have.
    next: u32,
    /// Bytes that were taken from the input, and those up to the end of the last whole record.
    taken: u64,
    whole: u64,
    records: u64,
    is_over: bool,
    damage: Option<Damage>,
}

impl<R> fmt::Debug for Recording<R> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Recording")
            .field("records", &self.records)
            .field("damage", &self.damage)
            .finish_non_exhaustive()
    }
}

/// What a record of the file is.
enum Step {
    /// The channel of the link's bytes was told.
    Channel,
    /// Bytes of the link.
    Bytes,
    /// All records have come.
    End,
    /// Something that is of no interest.
    Other,
}

impl Recording<BufReader<File>> {
    /// Opens a file.
    ///
    /// # Errors
    /// Fails with one line that names the file and the reason: it cannot be read, or has no bytes of the
    /// link.
    pub fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).with_context(|| shown(path))?;
        Self::new(BufReader::new(file)).with_context(|| shown(path))
    }
}

impl<R: Read> Recording<R> {
    /// Reads up to the channel of the link's bytes. A recording that is cut or damaged before is one
    /// without records.
    ///
    /// # Errors
    /// Fails when there is no such channel.
    pub fn new(input: R) -> Result<Self> {
        let options = LinearReaderOptions::default()
            // None is written, and none is unpacked.
            .with_emit_chunks(true)
            .with_validate_data_section_crc(true)
            .with_record_length_limit(RECORD_BYTES_MAX);
        let mut recording = Self {
            input,
            reader: LinearReader::new_with_options(options),
            channel: None,
            payload: Vec::new(),
            given: 0,
            arrived_ns: None,
            next: 0,
            taken: 0,
            whole: 0,
            records: 0,
            is_over: false,
            damage: None,
        };
        while recording.channel.is_none() && recording.damage.is_none() {
            ensure!(
                !matches!(recording.step(), Some(Step::End)),
                "an MCAP file, but no recording: it has no bytes of the link"
            );
        }
        Ok(recording)
    }

    /// The bytes of the next record, with the time at which they came, ns since 1970; `None` after the
    /// last one that is whole.
    pub fn next_record(&mut self) -> Option<(u64, &[u8])> {
        self.advance().then(|| {
            self.given = self.payload.len();
            (self.arrived_ns.unwrap_or_default(), &self.payload[..])
        })
    }

    /// Gives bytes of the link, of one record; none after the last one that is whole.
    pub fn read(&mut self, place: &mut [u8]) -> usize {
        while self.given == self.payload.len() {
            if !self.advance() {
                return 0;
            }
        }
        let rest = &self.payload[self.given..];
        let count = rest.len().min(place.len());
        place[..count].copy_from_slice(&rest[..count]);
        self.given += count;
        count
    }

    /// The time at which the bytes that were given last came, ns since 1970.
    #[must_use]
    pub fn arrived_ns(&self) -> Option<u64> {
        self.arrived_ns
    }

    /// Number of records that were read.
    #[must_use]
    pub fn records(&self) -> u64 {
        self.records
    }

    /// Where the recording is no longer whole, once it was read up to there.
    #[must_use]
    pub fn damage(&self) -> Option<&Damage> {
        self.damage.as_ref()
    }

    /// Goes to the next record, and returns whether there is one.
    fn advance(&mut self) -> bool {
        loop {
            match self.step() {
                Some(Step::Bytes) => return true,
                Some(Step::Channel | Step::Other) => {}
                Some(Step::End) | None => return false,
            }
        }
    }

    /// Reads a record of the file; `None` where it is damaged.
    fn step(&mut self) -> Option<Step> {
        if self.is_over {
            return Some(Step::End);
        }
        if self.damage.is_some() {
            return None;
        }
        match self.read_record() {
            Ok(step) => {
                self.whole = self.taken;
                self.records += u64::from(matches!(step, Step::Bytes));
                self.is_over = matches!(step, Step::End);
                Some(step)
            }
            Err(reason) => {
                self.damage = Some(Damage {
                    bytes: self.whole,
                    records: self.records,
                    reason,
                });
                None
            }
        }
    }

    fn read_record(&mut self) -> Result<Step, String> {
        loop {
            let event = self.reader.next_event();
            match event.unwrap_or(Err(McapError::UnexpectedEof)) {
                Ok(LinearReadEvent::ReadRequest(count)) => {
                    let place = self.reader.insert(count);
                    let count = loop {
                        match self.input.read(place) {
                            Err(error) if error.kind() == ErrorKind::Interrupted => {}
                            read => break read.map_err(|error| error.to_string())?,
                        }
                    };
                    self.reader.notify_read(count);
                    self.taken += count as u64;
                }
                Ok(LinearReadEvent::Record { opcode, data }) => match opcode {
                    op::CHANNEL => {
                        let (id, encoding) = channel(data).ok_or(NO_RECORD)?;
                        if encoding != ENCODING.as_bytes() {
                            return Ok(Step::Other);
                        }
                        self.channel = Some(id);
                        return Ok(Step::Channel);
                    }
                    op::MESSAGE => {
                        let mcap::records::Record::Message { header, data } = parsed(opcode, data)?
                        else {
                            return Ok(Step::Other);
                        };
                        if Some(header.channel_id) != self.channel {
                            return Ok(Step::Other);
                        }
                        if header.sequence != self.next || header.log_time != header.publish_time {
                            return Err("the head of the next record is damaged".to_owned());
                        }
                        self.next = header.sequence.wrapping_add(1);
                        self.arrived_ns = Some(header.log_time);
                        self.given = 0;
                        self.payload.clear();
                        self.payload.extend_from_slice(&data);
                        return Ok(Step::Bytes);
                    }
                    op::CHUNK if self.channel.is_some() => {
                        let chunk = "a chunk follows, which recordings do not have";
                        return Err(chunk.to_owned());
                    }
                    op::CHUNK | op::DATA_END => return Ok(Step::End),
                    _ => return Ok(Step::Other),
                },
                Err(McapError::RecordTooLarge {
                    opcode: op::CHUNK, ..
                }) if self.channel.is_none() => return Ok(Step::End),
                Err(error) => return Err(reason(&error)),
            }
        }
    }
}

/// Why what has no form of a record is not read.
const NO_RECORD: &str = "what follows is no record";

/// The number of a channel and the encoding of its messages; `None` if it is none. The crate `mcap` takes as
/// much memory for a text as its length states, before it looks whether there is so much.
fn channel(data: &[u8]) -> Option<(u16, &[u8])> {
    fn text(data: &[u8]) -> Option<(&[u8], &[u8])> {
        let (length, rest) = data.split_first_chunk()?;
        rest.split_at_checked(usize::try_from(u32::from_le_bytes(*length)).ok()?)
    }
    let (id, rest) = data.split_first_chunk()?;
    let (_schema, rest) = rest.split_first_chunk::<2>()?;
    let (_topic, rest) = text(rest)?;
    let (encoding, _metadata) = text(rest)?;
    Some((u16::from_le_bytes(*id), encoding))
}

fn parsed(opcode: u8, data: &[u8]) -> Result<mcap::records::Record<'_>, String> {
    mcap::parse_record(opcode, data).map_err(|error| reason(&error))
}

fn reason(error: &McapError) -> String {
    match error {
        McapError::UnexpectedEof => "it ends there, without an end".to_owned(),
        McapError::BadDataCrc { .. } => {
            "the checksum over all of them is wrong: some byte was changed".to_owned()
        }
        McapError::RecordTooLarge { .. } | McapError::Parse(_) => NO_RECORD.to_owned(),
        error => error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use mcap::Summary;

    use super::*;

    const PIECES: [(u64, &[u8]); 4] = [
        (1_000, b"\0\x03\x01\x02"),
        (1_000, b""),
        (2_500, &[0xff; 300]),
        (9_999_999_999, b"end\0"),
    ];

    fn recorded() -> Vec<u8> {
        let mut recorder = Recorder::new(Cursor::new(Vec::new())).unwrap();
        for (arrived_ns, bytes) in PIECES {
            recorder.push(arrived_ns, bytes).unwrap();
        }
        assert_eq!((recorder.records(), recorder.bytes()), (4, 308));
        recorder.finish().unwrap().into_inner()
    }

    fn read(file: &[u8]) -> (Vec<(u64, Vec<u8>)>, Option<Damage>) {
        let mut recording = Recording::new(file).unwrap();
        let mut records = Vec::new();
        while let Some((arrived_ns, bytes)) = recording.next_record() {
            records.push((arrived_ns, bytes.to_vec()));
        }
        assert_eq!(recording.records(), records.len() as u64);
        (records, recording.damage().cloned())
    }

    fn pieces() -> Vec<(u64, Vec<u8>)> {
        PIECES.map(|(at, bytes)| (at, bytes.to_vec())).to_vec()
    }

    #[test]
    fn gives_what_was_recorded_and_other_readers_agree() {
        let file = recorded();
        assert!(is_mcap(&file) && is_mcap(&file[..3]) && !is_mcap(&[]) && !is_mcap(&file[1..]));
        assert_eq!(read(&file), (pieces(), None));
        let messages = mcap::MessageStream::new(&file).unwrap();
        let messages: Vec<_> = messages.map(Result::unwrap).collect();
        let (times, bytes): (Vec<u64>, Vec<Vec<u8>>) = messages
            .iter()
            .map(|message| (message.log_time, message.data.to_vec()))
            .unzip();
        assert_eq!(times.into_iter().zip(bytes).collect::<Vec<_>>(), pieces());
        assert_eq!(messages[0].channel.message_encoding, "vgstereo-link");
        let summary = Summary::read(&file).unwrap().unwrap();
        assert_eq!(summary.stats.unwrap().message_count, 4);
    }

    #[test]
    fn small_reads_give_the_bytes_in_order_with_the_time_of_each() {
        let file = recorded();
        let mut recording = Recording::new(&file[..]).unwrap();
        let mut place = [0; 100];
        let mut reads = Vec::new();
        loop {
            let count = recording.read(&mut place);
            if count == 0 {
                break;
            }
            reads.push((count, recording.arrived_ns().unwrap()));
        }
        let expected = [
            (4, 1_000),
            (100, 2_500),
            (100, 2_500),
            (100, 2_500),
            (4, 9_999_999_999),
        ];
        assert_eq!(reads, expected);
    }

    #[test]
    fn a_cut_leaves_the_records_before_it() {
        let file = recorded();
        let mut seen = 0;
        for length in 1..file.len() {
            let (records, damage) = read(&file[..length]);
            assert_eq!(records[..], pieces()[..records.len()]);
            assert!(records.len() >= seen, "{length}");
            seen = records.len();
            if let Some(damage) = damage {
                assert_eq!(damage.records, records.len() as u64);
                assert!(damage.bytes <= length as u64);
            } else {
                assert_eq!(records.len(), 4, "{length}");
            }
        }
        assert_eq!(seen, 4);
    }

    #[test]
    fn what_follows_a_damaged_record_is_not_taken_for_whole() {
        let file = recorded();
        for at in 0..file.len() {
            for bit in 0..8 {
                let mut file = file.clone();
                file[at] ^= 1 << bit;
                let Ok(mut recording) = Recording::new(&file[..]) else {
                    continue;
                };
                let mut records = 0;
                let mut times = Vec::new();
                while let Some((arrived_ns, _)) = recording.next_record() {
                    times.push(arrived_ns);
                    records += 1;
                }
                // The time of a record that is given is the one that was written.
                let expected = PIECES.map(|(at, _)| at);
                assert_eq!(times[..], expected[..records], "{at} {bit}");
                if records < 4 {
                    assert!(recording.damage().is_some(), "{at} {bit}");
                }
            }
        }
    }

    #[test]
    fn an_mcap_file_without_bytes_of_the_link_is_no_recording() {
        for use_chunks in [false, true] {
            let options = WriteOptions::new().compression(None).use_chunks(use_chunks);
            let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
            let channel = writer
                .add_channel(0, "/a", "json", &BTreeMap::new())
                .unwrap();
            let header = MessageHeader {
                channel_id: channel,
                sequence: 0,
                log_time: 0,
                publish_time: 0,
            };
            let big = vec![b' '; 2 * RECORD_BYTES_MAX];
            let data = if use_chunks { &big[..] } else { b"{}" };
            writer.write_to_known_channel(&header, data).unwrap();
            writer.finish().unwrap();
            let file = writer.into_inner().into_inner();
            let error = Recording::new(&file[..]).unwrap_err().to_string();
            assert!(error.contains("no bytes of the link"), "{error}");
        }
    }
}
