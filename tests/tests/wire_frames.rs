//! Framing: what is packed comes back, what is damaged is named, and no bytes make it panic.

use shared::wire::framing::{Deframer, Frame, FrameError, MAX_FRAME, Packet};
use shared::wire::message::{Command, Event, MAX_RAW_SAMPLES, Message, Raw, SAMPLE, Segment, pack};
use shared::wire::version::{self, Version};

/// Pseudo-random bytes (Marsaglia's xorshift), the same in every run.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// Mostly zeros, mostly not zeros or evenly spread, by `kind`.
    fn byte(&mut self, kind: u64) -> u8 {
        let random = self.next();
        match (kind % 3, random % 8) {
            (0, 0..6) => 0,
            (1, _) => (random >> 32) as u8 | 1,
            _ => (random >> 32) as u8,
        }
    }
}

fn frame_of(codes: &[u8], sequence: u16) -> Frame {
    let mut frame = Frame::new();
    let raw = Raw {
        segment: Segment::Idle,
        first_sample: u64::from(sequence),
        codes,
    };
    frame.encode(&Event::Raw(raw), sequence).expect("fits");
    frame
}

#[test]
fn frames_of_any_length_and_content_come_back() {
    let mut noise = Noise(1);
    for round in 0..3000u64 {
        let length = noise.next() as usize % (MAX_RAW_SAMPLES * SAMPLE + 1);
        let codes: Vec<u8> = (0..length).map(|_| noise.byte(round)).collect();
        let frame = frame_of(&codes, round as u16);
        let bytes = frame.as_bytes();
        assert!(bytes.len() <= MAX_FRAME);
        assert_eq!(
            bytes.iter().position(|&byte| byte == 0),
            Some(bytes.len() - 1)
        );
        let mut stuffed = bytes[..bytes.len() - 1].to_vec();
        let packet = Packet::open(&mut stuffed).expect("sound");
        assert_eq!(packet.sequence, round as u16);
        let Ok(Event::Raw(raw)) = packet.message() else {
            panic!("not a raw event: {:?}", packet.message::<Event>());
        };
        assert_eq!((raw.first_sample, raw.codes), (round, codes.as_slice()));
    }
}

#[test]
fn stuffing_is_that_of_the_released_crate() {
    let mut noise = Noise(2);
    for round in 0..3000u64 {
        let length = noise.next() as usize % (MAX_RAW_SAMPLES * SAMPLE + 1);
        let codes: Vec<u8> = (0..length).map(|_| noise.byte(round)).collect();
        let frame = frame_of(&codes, 0);
        let stuffed = &frame.as_bytes()[..frame.as_bytes().len() - 1];
        let content = cobs::decode_vec(stuffed).expect("the crate decodes it");
        let mut again = cobs::encode_vec(&content);
        Packet::open(&mut again).expect("and we decode the crate's");
    }
}

#[test]
fn checksum_is_the_published_crc_32() {
    // The check value of CRC-32/ISO-HDLC is CBF43926 for "123456789"; here that is the content of a frame.
    let mut content = b"123456789".to_vec();
    content.extend(0xCBF4_3926u32.to_le_bytes());
    let mut stuffed = cobs::encode_vec(&content);
    assert_eq!(
        Packet::open(&mut stuffed),
        Err(FrameError::Version(Version(b'1')))
    );
}

#[test]
fn every_single_flipped_bit_is_noticed() {
    let codes: Vec<u8> = (0..SAMPLE as i32 * 8)
        .flat_map(|k| pack(&[k, -k, k << 12, 0]))
        .take(MAX_RAW_SAMPLES * SAMPLE)
        .collect();
    let frame = frame_of(&codes, 7);
    let stuffed = &frame.as_bytes()[..frame.as_bytes().len() - 1];
    for bit in 0..stuffed.len() * 8 {
        let mut damaged = stuffed.to_vec();
        damaged[bit / 8] ^= 1 << (bit % 8);
        let mut deframer = Deframer::default();
        damaged.push(0);
        let mut bytes = damaged.as_slice();
        while !bytes.is_empty() {
            let (taken, packet) = deframer.feed(bytes);
            bytes = &bytes[taken..];
            if let Some(packet) = packet {
                assert!(packet.is_err(), "bit {bit}: {packet:?}");
            }
        }
    }
}

#[test]
fn a_stream_cut_anywhere_gives_the_same_frames() {
    let mut noise = Noise(3);
    let mut stream = vec![0, 0];
    for sequence in 0..200u16 {
        let codes: Vec<u8> = (0..SAMPLE * (usize::from(sequence) % 33))
            .map(|_| noise.byte(2))
            .collect();
        stream.extend(frame_of(&codes, sequence).as_bytes());
    }
    for _ in 0..20 {
        let mut deframer = Deframer::new();
        let mut sequences = Vec::new();
        let mut rest = stream.as_slice();
        while !rest.is_empty() {
            let (mut piece, after) = rest.split_at(rest.len().min(1 + noise.next() as usize % 500));
            rest = after;
            while !piece.is_empty() {
                let (taken, packet) = deframer.feed(piece);
                assert!(taken > 0);
                piece = &piece[taken..];
                if let Some(packet) = packet {
                    sequences.push(packet.expect("sound").sequence);
                }
            }
        }
        assert_eq!(sequences, (0..200).collect::<Vec<u16>>());
    }
}

#[test]
fn garbage_gives_errors_and_the_next_frame_is_read() {
    let mut noise = Noise(4);
    let mut deframer = Deframer::new();
    let mut errors = 0;
    let mut overlong = 0;
    for round in 0..400u64 {
        let length = noise.next() as usize % 3000;
        let mut stream: Vec<u8> = (0..length).map(|_| noise.byte(round)).collect();
        stream.push(0);
        stream.extend(frame_of(&[1; SAMPLE], round as u16).as_bytes());
        let mut bytes = stream.as_slice();
        let mut found = Vec::new();
        while !bytes.is_empty() {
            let (taken, packet) = deframer.feed(bytes);
            bytes = &bytes[taken..];
            match packet {
                Some(Ok(packet)) => found.push(packet.sequence),
                Some(Err(FrameError::TooLong)) => overlong += 1,
                Some(Err(_)) => errors += 1,
                None => (),
            }
        }
        assert_eq!(found, [round as u16]);
    }
    assert!(errors > 1000 && overlong > 30, "{errors} {overlong}");
}

#[test]
fn any_bytes_decode_to_a_message_or_an_error() {
    let mut noise = Noise(5);
    for round in 0..200_000u64 {
        let length = noise.next() as usize % 60;
        let mut content = vec![version::CURRENT.0, 0, 0];
        content.push((noise.next() % 12) as u8);
        content.extend((0..length).map(|_| noise.byte(round)));
        let sum = crc32(&content);
        content.extend(sum.to_le_bytes());
        let mut stuffed = cobs::encode_vec(&content);
        let packet = Packet::open(&mut stuffed).expect("sound as a frame");
        let _ = packet.message::<Command>();
        if let Ok(Event::Raw(raw)) = packet.message() {
            assert_eq!(raw.samples().len(), raw.codes.len() / SAMPLE);
        }
    }
}

/// CRC-32/ISO-HDLC bit by bit, from its definition.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |sum, &byte| {
        (0..8).fold(sum ^ u32::from(byte), |sum, _| {
            (sum >> 1) ^ if sum & 1 == 1 { 0xEDB8_8320 } else { 0 }
        })
    })
}

#[test]
fn left_over_bytes_are_an_error() {
    struct Longer(Command, u8);
    impl serde::Serialize for Longer {
        fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            (self.0, self.1).serialize(serializer)
        }
    }
    impl Message for Longer {
        fn version(&self) -> Version {
            self.0.version()
        }
    }
    let mut frame = Frame::new();
    frame
        .encode(&Longer(Command::AskState, 0), 1)
        .expect("fits");
    let mut stuffed = frame.as_bytes()[..frame.as_bytes().len() - 1].to_vec();
    let packet = Packet::open(&mut stuffed).expect("sound");
    assert_eq!(packet.message::<Command>(), Err(FrameError::Message));
}

#[test]
fn codes_of_24_bits_come_back() {
    use shared::wire::message::unpack;
    for codes in [
        [0, 1, -1, 255],
        [-8_388_608, 8_388_607, -256, 65_536],
        [123_456, -123_456, 7, -7],
    ] {
        assert_eq!(unpack(&pack(&codes)), codes);
    }
}
