//! Records: sound frames in any order, damaged; read as they are, in pieces, and measured.

use std::path::Path;

use arbitrary::Unstructured;
use host::error::Error;
use host::gate;
use host::import::Columns;
use host::measure::{Calibration, Request, measure};
use host::record::{self, Item, Note, Reader, RecordError, Tally};
use shared::wire::framing::Frame;
use shared::wire::message::{Block, Event, Identity, Moments, Plateau, Raw, Run, Segment, pack};
use shared::wire::version;

use crate::draw::{below, one_in, one_of, spoil};
use crate::{Fuzz, Judged, proper};

/// The target.
pub struct Frames;

fn frame(event: &Event<'_>, sequence: u16) -> Vec<u8> {
    let mut frame = Frame::new();
    match frame.encode(event, sequence) {
        Ok(()) => frame.as_bytes().to_vec(),
        Err(_) => Vec::new(),
    }
}

fn segment(draw: &mut Unstructured<'_>) -> Segment {
    let plateau = *one_of(draw, &[Plateau::Before, Plateau::During, Plateau::After]);
    match below(draw, 6) {
        0 => Segment::Idle,
        1 => Segment::Reading(draw.arbitrary().unwrap_or(0)),
        _ => Segment::Run(Run { run: 1, plateau }),
    }
}

/// A number of samples, also near the end of numbers.
fn index(draw: &mut Unstructured<'_>, near: u64) -> u64 {
    match below(draw, 10) {
        0 => u64::MAX - below(draw, 100) as u64,
        1 => draw.arbitrary().unwrap_or(0),
        _ => near,
    }
}

fn event(draw: &mut Unstructured<'_>, near: u64, sequence: u16) -> Vec<u8> {
    let identity = Identity {
        minimum: version::MINIMUM,
        current: version::CURRENT,
        firmware: [0, 1, 0],
        serial: [1; 12],
        sample_rate_hz: *one_of(draw, &[4000.0, 4000.0, 0.0, -1.0, f64::NAN, 1e300, 5e-324]),
        reference_v: *one_of(draw, &[1.2, 1.2, 1.2, 0.0, f64::INFINITY]),
        gains: *one_of(draw, &[[1; 4], [1; 4], [0; 4]]),
        block_samples: 40,
    };
    let first_sample = index(draw, near);
    match below(draw, 8) {
        0 => frame(&Event::Hello(identity), sequence),
        1 => {
            let block = Block {
                segment: segment(draw),
                first_sample,
                count: *one_of(draw, &[40, 40, 0, u32::MAX]),
                lost: *one_of(draw, &[0, 0, 1, u32::MAX]),
                moments: Moments::default(),
            };
            frame(&Event::Block(block), sequence)
        }
        2 => {
            let bytes: [u8; 64] = draw.arbitrary().unwrap_or([0; 64]);
            let any: Option<Event<'_>> = postcard::from_bytes(&bytes).ok();
            any.map_or(Vec::new(), |any| frame(&any, sequence))
        }
        3 => {
            let text = "a remark";
            let note = Note::Remark {
                reading: None,
                text,
            };
            note.frame()
                .map_or(Vec::new(), |frame| frame.as_bytes().to_vec())
        }
        _ => {
            let codes: Vec<u8> = (0..32)
                .flat_map(|n| pack(&[1000 * n, -1, below(draw, 1 << 20) as i32, 77]))
                .collect();
            let raw = Raw {
                segment: segment(draw),
                first_sample,
                codes: &codes,
            };
            frame(&Event::Raw(raw), sequence)
        }
    }
}

/// What a record holds: its items as text, and the count.
fn read(bytes: &[u8], piece: usize) -> Result<(Vec<String>, Tally), String> {
    let mut reader = Reader::new();
    let mut items = Vec::new();
    let mut sink = |item: Item<'_>, _: &Tally| {
        items.push(format!("{item:?}"));
        Ok::<(), RecordError>(())
    };
    for piece in bytes.to_vec().chunks_mut(piece.max(1)) {
        match reader.feed_items(piece, &mut sink) {
            Ok(()) => {}
            // Two instruments: the record ends there, in one line.
            Err(error) if error.to_string().lines().count() == 1 => break,
            Err(error) => return Err(format!("in several lines: {error}")),
        }
    }
    let tally = reader.finish();
    Ok((items, tally))
}

fn check(bytes: &[u8], piece: usize) -> Judged {
    let (whole, tally) = read(bytes, usize::MAX)?;
    let (pieces, again) = read(bytes, piece)?;
    if whole != pieces || format!("{tally:?}") != format!("{again:?}") {
        return Err(format!("in pieces of {piece}: {tally:?} becomes {again:?}"));
    }
    let read_on = record::read_items(bytes, |_, _| Ok::<(), RecordError>(())).is_ok();
    if read_on && tally.bytes != bytes.len() as u64 {
        return Err(format!(
            "{} bytes, {} accounted for",
            bytes.len(),
            tally.bytes
        ));
    }
    measured(bytes)
}

/// Measures the record.
fn measured(bytes: &[u8]) -> Judged {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let file = folder.path().join("record.vre");
    std::fs::write(&file, bytes).map_err(|error| error.to_string())?;
    let request = Request {
        columns: Columns {
            outputs: Vec::new(),
            time: None,
            temperature: None,
        },
        selection: None,
        run: None,
        calibration: Calibration {
            units_per_g: 0.12,
            full_scale_g: None,
            temperature_sensitivity_g_per_c: None,
        },
    };
    let answer: Result<(), Error> = measure(&file, &request).and_then(|found| gate::check(&found));
    answer.or_else(|error| proper(&error))
}

impl Fuzz for Frames {
    fn input(&mut self, draw: &mut Unstructured<'_>) -> Judged {
        let mut bytes = Vec::new();
        let (mut near, mut sequence) = (0, 0);
        for _ in 0..=below(draw, 24) {
            bytes.extend(event(draw, near, sequence));
            near += 32;
            sequence = match one_in(draw, 12) {
                true => draw.arbitrary().unwrap_or(0),
                false => sequence.wrapping_add(1),
            };
        }
        if one_in(draw, 3) {
            spoil(draw, &mut bytes);
        }
        check(&bytes, 1 + below(draw, 100))
    }

    fn file(&mut self, path: &Path) -> Judged {
        let bytes = std::fs::read(path).map_err(|error| error.to_string())?;
        check(&bytes, 7)
    }
}
