//! Records: cut, damaged, mixed, rubbish.

use std::io::Read;

use host::record::{
    self, Item, Note, Reader, ReadingNote, RecordError, RunNote, Samples, Tally, Writer,
};
use proptest::prelude::*;
use shared::wire::Event;
use shared::wire::framing::Frame;
use shared::wire::message::{Approach, Block, Identity, Moments, Position, Raw, Segment, pack};
use shared::wire::version::{CURRENT, MINIMUM};

const SAMPLES: u64 = 8;

fn frame(event: &Event<'_>, sequence: u16) -> Vec<u8> {
    let mut frame = Frame::new();
    frame.encode(event, sequence).unwrap();
    frame.as_bytes().to_vec()
}

fn hello(serial: u8, sequence: u16) -> Vec<u8> {
    let identity = Identity {
        minimum: MINIMUM,
        current: CURRENT,
        firmware: [0, 1, 0],
        serial: [serial; 12],
        sample_rate_hz: 4000.0,
        reference_v: 1.2,
        gains: [1; 4],
        block_samples: 40,
    };
    frame(&Event::Hello(identity), sequence)
}

fn raw(first_sample: u64, sequence: u16) -> Vec<u8> {
    let sample = |n: u64| pack(&[n as i32 * 1000, -1, 0, 77]);
    let codes: Vec<u8> = (first_sample..first_sample + SAMPLES)
        .flat_map(sample)
        .collect();
    frame(
        &Event::Raw(Raw {
            segment: Segment::Idle,
            first_sample,
            codes: &codes,
        }),
        sequence,
    )
}

fn block(first_sample: u64, count: u32, lost: u32, sequence: u16) -> Vec<u8> {
    let moments = Moments::default();
    let block = Block {
        segment: Segment::Idle,
        first_sample,
        count,
        lost,
        moments,
    };
    frame(&Event::Block(block), sequence)
}

/// Hello, then `count` raw frames without a gap.
fn frames(count: u64) -> Vec<Vec<u8>> {
    let mut frames = vec![hello(1, 65_000)];
    frames.extend((0..count).map(|n| raw(n * SAMPLES, 65_001u16.wrapping_add(n as u16))));
    frames
}

/// The first samples of the raw frames that came through, and the tally.
fn read(bytes: &[u8]) -> (Vec<u64>, Tally) {
    let mut firsts = Vec::new();
    let tally = record::read(bytes, |event, _| -> Result<(), RecordError> {
        if let Event::Raw(raw) = event {
            assert_eq!(raw.samples().len() as u64, SAMPLES);
            firsts.push(raw.first_sample);
        }
        Ok(())
    });
    (firsts, tally.unwrap())
}

#[test]
fn a_sound_record_comes_back_whole_over_the_wrap_of_the_sequence() {
    let (firsts, tally) = read(&frames(2000).concat());
    assert_eq!(firsts, (0..2000).map(|n| n * SAMPLES).collect::<Vec<_>>());
    let raw = Samples {
        received: 2000 * SAMPLES,
        ..Samples::default()
    };
    let bytes = tally.bytes;
    assert_eq!(
        tally,
        Tally {
            bytes,
            frames: 2001,
            raw,
            ..Tally::default()
        }
    );
}

#[test]
fn appending_continues_a_record() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("0001.raw");
    let frames = frames(3);
    for frame in &frames {
        let mut writer = Writer::append(&file).unwrap();
        writer.write(frame).unwrap();
        writer.finish().unwrap();
    }
    assert_eq!(std::fs::read(&file).unwrap(), frames.concat());
}

const REMARK: Note<'_> = Note::Remark {
    reading: Some(7),
    text: "touched the table",
};

/// Bytes come cut anywhere, and a note between two pieces: no frame is cut by it, none is lost.
#[test]
fn a_note_stands_between_whole_frames_however_the_bytes_come() {
    let folder = tempfile::tempdir().unwrap();
    let whole = frames(3).concat();
    for cut in 0..whole.len() {
        let file = folder.path().join(format!("{cut}.vre"));
        let mut writer = Writer::append(&file).unwrap();
        writer.write(&whole[..cut]).unwrap();
        writer.note(&REMARK).unwrap();
        writer.write(&whole[cut..]).unwrap();
        writer.finish().unwrap();
        let bytes = std::fs::read(&file).unwrap();
        let (firsts, tally) = read(&bytes);
        assert_eq!(firsts, [0, SAMPLES, 2 * SAMPLES], "cut at {cut}");
        assert_eq!((tally.frames, tally.notes, tally.damaged_bytes), (4, 1, 0));
        let mut notes = 0;
        record::read_items(bytes.as_slice(), |item, _| {
            if let Item::Note(note) = item {
                assert_eq!(note, REMARK);
                notes += 1;
            }
            Ok::<(), RecordError>(())
        })
        .unwrap();
        assert_eq!(notes, 1);
    }
}

/// After a power failure the file ends in the middle of a frame.
#[test]
fn a_note_after_half_a_frame_is_read_all_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("half.vre");
    let first = hello(1, 0);
    std::fs::write(&file, [&first[..], &raw(0, 1)[..20]].concat()).unwrap();
    let mut writer = Writer::append(&file).unwrap();
    writer.note(&REMARK).unwrap();
    writer.finish().unwrap();
    let (_, tally) = read(&std::fs::read(&file).unwrap());
    assert_eq!(
        (tally.frames, tally.notes, tally.damaged_stretches),
        (1, 1, 1)
    );
}

/// The bytes of every kind of note, which no later version may change.
#[test]
fn notes_have_the_bytes_that_they_had_before() {
    let position = Position {
        reading: 3,
        series: 2,
        dial_deg: 135.0,
        mount_deg: 180.0,
        approach: Approach::Ccw,
    };
    let run = RunNote {
        run: 4,
        random: true,
        direction: [1.0, 0.0, 0.0],
        level_g: 2.0,
        band_hz: [20.0, 200.0],
        a0: [0.0, 0.0, 1.0],
        time_s: 90.0,
        temp_c: 22.0,
        blocks: 400,
        reference_v_per_g: 0.125,
    };
    let reading = ReadingNote {
        position,
        time_s: 90.0,
        temp_c: 22.5,
        blocks: 100,
    };
    let notes = [
        Note::Began {
            unix_ms: 1_700_000_000_000,
        },
        Note::Head {
            part: 0,
            parts: 2,
            text: "format",
        },
        Note::Reading(reading),
        Note::ReadingTaken { reading: 3 },
        Note::ReadingWithdrawn { reading: 3 },
        Note::Run(run),
        Note::RunTaken { run: 4 },
        REMARK,
    ];
    let hex = |note: &Note<'_>| -> String {
        let frame = note.frame().unwrap();
        frame
            .as_bytes()
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect()
    };
    let found: Vec<String> = notes.iter().map(hex).collect();
    let golden: Vec<&str> = GOLDEN_NOTES.lines().collect();
    assert_eq!(found, golden);
}

const GOLDEN_NOTES: &str = include_str!("golden_notes.txt");

#[test]
fn a_lost_stretch_is_counted_in_frames_and_samples() {
    let mut frames = frames(100);
    frames.drain(40..57);
    let (firsts, tally) = read(&frames.concat());
    assert_eq!(firsts.len(), 83);
    assert_eq!((tally.missing_frames, tally.damaged_bytes), (17, 0));
    assert_eq!((tally.raw.missing, tally.raw.not_sent), (17 * SAMPLES, 0));
}

#[test]
fn samples_that_were_never_sent_are_not_called_lost_on_the_way() {
    let bytes = [
        hello(1, 0),
        raw(0, 1),
        raw(100, 2),
        block(0, 40, 2, 3),
        block(42, 40, 0, 4),
    ];
    let (_, tally) = read(&bytes.concat());
    let raw = Samples {
        received: 2 * SAMPLES,
        missing: 0,
        not_sent: 100 - SAMPLES,
    };
    assert_eq!((tally.raw, tally.missing_frames), (raw, 0));
    assert_eq!(
        tally.blocks,
        Samples {
            received: 80,
            missing: 0,
            not_sent: 2
        }
    );
}

#[test]
fn every_flipped_bit_costs_at_most_two_frames_and_is_accounted_for() {
    let frames = frames(6);
    let whole = frames.concat();
    let length = whole.len() as u64;
    for bit in 0..8 * whole.len() {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        let (firsts, tally) = read(&bytes);
        assert!(firsts.len() >= 4, "bit {bit}");
        assert!(firsts.is_sorted());
        assert_eq!(tally.bytes, length);
        let sound: u64 = frames.iter().map(|frame| frame.len() as u64).sum();
        assert!(tally.damaged_bytes + tally.idle_delimiters > 0 && tally.damaged_bytes < sound);
        assert!(tally.frames + tally.missing_frames <= 7);
    }
}

#[test]
fn a_record_cut_anywhere_gives_all_whole_frames() {
    let frames = frames(4);
    let whole = frames.concat();
    let ends: Vec<usize> = frames
        .iter()
        .scan(0, |end, frame| {
            *end += frame.len();
            Some(*end)
        })
        .collect();
    for cut in 0..=whole.len() {
        let (_, tally) = read(&whole[..cut]);
        let sound = ends.iter().filter(|&&end| end <= cut).count();
        let last = ends[..sound].last().copied().unwrap_or(0);
        assert_eq!(tally.frames, sound as u64);
        assert_eq!(tally.damaged_bytes, (cut - last) as u64);
    }
}

#[test]
fn two_instruments_in_one_record_are_an_error_that_names_both() {
    let bytes = [hello(1, 0), raw(0, 1), hello(1, 2), hello(2, 3)].concat();
    let outcome = record::read(bytes.as_slice(), |_, _| -> Result<(), RecordError> {
        Ok(())
    });
    let error = outcome.unwrap_err().in_file("x.raw".as_ref());
    assert_eq!(error.exit_status(), 2);
    let line = error.to_string();
    assert!(
        line.contains("010101") && line.contains("020202") && line.contains("x.raw"),
        "{line}"
    );
}

#[test]
fn a_restart_of_the_instrument_is_no_loss() {
    let bytes = [hello(1, 500), raw(4000, 501), hello(1, 0), raw(0, 1)].concat();
    let (firsts, tally) = read(&bytes);
    assert_eq!(firsts, [4000, 0]);
    assert_eq!(
        (tally.restarts, tally.missing_frames, tally.raw.missing),
        (1, 0, 0)
    );
}

#[test]
fn an_index_of_samples_that_goes_back_is_a_restart_though_the_sequence_goes_on() {
    let bytes = [hello(1, 0), raw(4000, 1), hello(1, 2), raw(0, 3), raw(8, 4)].concat();
    let (_, tally) = read(&bytes);
    assert_eq!(
        (tally.restarts, tally.raw.missing, tally.raw.not_sent),
        (1, 0, 0)
    );
}

/// Endless rubbish without and with delimiters, in constant memory.
#[test]
fn rubbish_is_read_to_its_end_and_counted() {
    struct Rubbish {
        left: u64,
        state: u64,
        keep: u8,
    }
    impl Read for Rubbish {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let length = self.left.min(buffer.len() as u64);
            for byte in &mut buffer[..length as usize] {
                self.state = self
                    .state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                *byte = (self.state >> 56) as u8 | self.keep;
            }
            self.left -= length;
            Ok(length as usize)
        }
    }
    for keep in [0, 1] {
        let left = 20_000_000;
        let rubbish = Rubbish {
            left,
            state: 7,
            keep,
        };
        let tally = record::read(rubbish, |_, _| -> Result<(), RecordError> { Ok(()) }).unwrap();
        assert_eq!((tally.bytes, tally.frames), (left, 0));
        assert_eq!(tally.damaged_bytes + tally.idle_delimiters, left);
    }
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic_and_none_go_uncounted(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..3000), 0..6),
    ) {
        let mut reader = Reader::new();
        let mut nothing = |_: Event<'_>, _: &Tally| -> Result<(), RecordError> { Ok(()) };
        for piece in &pieces {
            // Two instruments, in rubbish, would be an error, not a panic.
            let _ = reader.feed(&mut piece.clone(), &mut nothing);
        }
        let total: usize = pieces.iter().map(Vec::len).sum();
        prop_assert_eq!(reader.finish().bytes, total as u64);
    }

    #[test]
    fn how_the_bytes_are_cut_into_pieces_does_not_matter(
        cuts in prop::collection::vec(1usize..300, 1..40),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..10),
    ) {
        let mut bytes = frames(10).concat();
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let mut nothing = |_: Event<'_>, _: &Tally| -> Result<(), RecordError> { Ok(()) };
        let mut reader = Reader::new();
        let mut rest = bytes.clone();
        for cut in cuts.into_iter().cycle() {
            if rest.is_empty() {
                break;
            }
            let tail = rest.split_off(cut.min(rest.len()));
            reader.feed(&mut rest, &mut nothing).unwrap();
            rest = tail;
        }
        prop_assert_eq!(reader.finish(), read(&bytes).1);
    }
}
