//! The instrument's memory: the old configuration or the new at every instant at which power may fail, a fault and
//! never a wrong configuration from a flash that went bad.

use embassy_futures::block_on;
use firmware::store::{Kept, SLOT, Store};
use host::bench::flash::{ERASURE, Fault, Flash, Power, SECTOR, SECTORS, WORD};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use shared::compensate::{Mode, Source, StatedErrors};
use shared::rectification::Covariance;
use shared::wire::configuration::{
    Calibration, Certified, Compensation, Configuration, Date, NAME, Name, Provenance,
};
use shared::wire::message::{Coefficients, StoreFault};

const SLOTS_OF_SECTOR: usize = SECTOR / SLOT;

/// What is kept: a configuration or none.
type Content = Option<Certified>;

/// A configuration that differs from those of other numbers in every part; every seventh has no calibration.
fn configuration(n: u32) -> Certified {
    let x = f64::from(n + 1) / 4.0;
    let configuration = Configuration {
        compensation: Compensation {
            mode: [None, Some(Mode::Block), Some(Mode::Pointwise)][n as usize % 3],
            source: Source::Reference,
            block_samples: 4 + n as u16,
            nominal_v_per_g: 0.1 + n as f32,
            reference_v_per_g: [0.1, -0.2, 0.3 + n as f32],
            reference_zero_v: [0.0, 1e-3, -1e-3 * n as f32],
        },
        calibration: (n % 7 != 6).then(|| Calibration {
            coefficients: Coefficients {
                nominal: std::array::from_fn(|k| x / (k + 1) as f64),
                further: std::array::from_fn(|k| -x / (k + 1) as f64),
            },
            covariance: Covariance::from_fn(|j, k| {
                if j == k {
                    (n as usize + j + 1) as f32
                } else {
                    (j + k) as f32 / 64.0
                }
            }),
            rank: 11,
        }),
    };
    Certified {
        configuration,
        provenance: (!n.is_multiple_of(3)).then(|| provenance(n)),
        errors: StatedErrors {
            scale_factor_drift: n as f32 / 2048.0,
            ..StatedErrors::default()
        },
    }
}

fn provenance(n: u32) -> Provenance {
    Provenance {
        serial: Name::new(&format!("V{n:05}")).expect("a name"),
        date: Date {
            year: 2026,
            month: 1 + (n % 12) as u8,
            day: 1 + (n % 28) as u8,
        },
        campaign: [n as u8; 32],
        temperature_c: Some([-40.0, n as f32 / 10.0]),
        accepted_by: Some([1, 2, n as u8]),
    }
}

/// What is told to be kept the nth time: every fifth time nothing.
fn content(n: u32) -> Content {
    (n % 5 != 4).then(|| configuration(n))
}

fn load(flash: &Flash) -> (Content, Kept) {
    block_on(Store::new(flash.clone()).load())
}

fn keep(flash: Flash, content: &Content) -> (Flash, Kept) {
    let mut store = Store::new(flash);
    let kept = block_on(store.keep(content.as_ref()));
    (store.into_flash(), kept)
}

/// Keeps it, which has to succeed.
fn keep_well(flash: Flash, content: &Content) -> Flash {
    let (flash, kept) = keep(flash, content);
    assert_eq!(kept.fault, None);
    assert_eq!(load(&flash), (*content, kept));
    flash
}

/// A flash in which that many contents were kept one after the other.
fn kept(count: u32) -> Flash {
    (0..count).fold(Flash::new(1), |flash, n| keep_well(flash, &content(n)))
}

/// Keeps what comes `n`th with power for `left`, and says what is found when it is back: that, or what was before, and
/// a memory that works.
fn cut(before: &Flash, n: u32, left: usize, seed: u64) {
    let (old, new) = (n.checked_sub(1).and_then(content), content(n));
    let mut flash = before.clone().with_seed(seed);
    flash.power = Power::Left(left);
    let (mut flash, told) = keep(flash, &new);
    let failed = flash.power == Power::Failed;
    flash.power = Power::On;
    let (found, kept) = load(&flash);
    let at = format!("writing {n}, power for {left}, seed {seed}: {kept:?}, told {told:?}");
    assert!(found == old || found == new, "{at}");
    assert!(told.fault.is_none() || failed, "{at}");
    if told.fault.is_none() {
        assert_eq!(found, new, "{at}");
    }
    // Before anything was ever kept a torn record may be taken for one that went bad.
    let virgin = n == 0 && found.is_none() && kept.fault == Some(StoreFault::Corrupt);
    assert!(kept.fault.is_none() || virgin, "{at}");
    let flash = keep_well(flash, &Some(configuration(1000)));
    assert_eq!(flash.overwritten, 0, "{at}");
}

#[test]
fn a_cut_of_power_at_any_byte_leaves_the_old_or_the_new() {
    let mut chance = ChaCha8Rng::seed_from_u64(7);
    let (mut flash, mut cuts) = (Flash::new(1), 0);
    let slots = (SECTORS * SLOTS_OF_SECTOR) as u32;
    for n in 0..slots + 34 {
        // Record and mark; and a sector where the ring enters one.
        let enters = (n as usize).is_multiple_of(SLOTS_OF_SECTOR);
        let bytes = SLOT + if enters { ERASURE } else { 0 };
        // Every byte where a sector begins or ends and in between; some elsewhere.
        let edge = matches!(n as usize % SLOTS_OF_SECTOR, 0 | 1 | 15);
        let points: Vec<usize> = match edge {
            true => (0..=bytes).collect(),
            false => (0..6).map(|_| chance.random_range(0..=bytes)).collect(),
        };
        for left in points {
            cut(&flash, n, left, chance.random());
            cuts += 1;
        }
        if enters {
            // Each way in which an erasure may be torn, many times over.
            for left in (0..ERASURE).cycle().take(8 * ERASURE) {
                cut(&flash, n, left, chance.random());
                cuts += 1;
            }
        }
        flash = keep_well(flash, &content(n));
    }
    assert!(flash.erasures > SECTORS);
    println!("{cuts} cuts");
}

/// Power fails again and again, also in what follows a failure.
#[test]
fn cut_after_cut_leaves_what_was_kept_last_or_what_was_being_kept() {
    let mut chance = ChaCha8Rng::seed_from_u64(11);
    let mut flash = Flash::new(2);
    let (mut now, mut cuts) = (content(0), 0);
    flash = keep_well(flash, &now);
    for n in 1..2000 {
        let new = content(n);
        flash.power = match chance.random_range(0..4) {
            0 => Power::On,
            _ => Power::Left(chance.random_range(0..SLOT + 2 * ERASURE)),
        };
        let (torn, told) = keep(flash, &new);
        cuts += usize::from(torn.power == Power::Failed);
        flash = torn;
        flash.power = Power::On;
        let (found, kept) = load(&flash);
        assert_eq!(kept.fault, None, "{n}");
        assert!(found == now || found == new, "{n}");
        assert!(told.fault.is_some() || found == new, "{n}");
        assert_eq!(flash.overwritten, 0);
        now = found;
    }
    println!("{cuts} cuts, {} erasures", flash.erasures);
}

#[test]
fn bits_that_flip_in_what_is_kept_give_a_fault_and_not_another_configuration() {
    // Of the first record, of a later one, of the first in a sector, of an erasure, and after the ring has gone round.
    for count in [1, 2, 12, 17, 25, 140] {
        let flash = kept(count);
        let sound = load(&flash);
        let start = (count as usize - 1) % (SECTORS * SLOTS_OF_SECTOR) * SLOT;
        let mut noticed = 0;
        for bit in 0..8 * SLOT {
            let mut flipped = flash.clone();
            flipped.bytes[start + bit / 8] ^= 1 << (bit % 8);
            let found = load(&flipped);
            if found == sound {
                // In the mark, where a bit decides nothing.
                assert!(bit >= 8 * (SLOT - WORD), "{count} {bit}");
            } else {
                let fault = Some(StoreFault::Corrupt);
                assert_eq!(found, (None, Kept { writes: 0, fault }), "{count} {bit}");
                noticed += 1;
            }
            if bit % 97 == 0 {
                keep_well(flipped, &content(1));
            }
        }
        assert_eq!(noticed, 8 * (SLOT - WORD));
    }
}

#[test]
fn bits_that_flip_anywhere_never_give_a_configuration_that_was_not_kept_last() {
    let mut chance = ChaCha8Rng::seed_from_u64(13);
    for count in [3, 31, 64, 150] {
        let flash = kept(count);
        let (sound, _) = load(&flash);
        for _ in 0..1000 {
            let mut flipped = flash.clone();
            for _ in 0..chance.random_range(1..200) {
                let at = chance.random_range(0..flipped.bytes.len());
                flipped.bytes[at] ^= 1 << chance.random_range(0..8);
            }
            let (found, kept) = load(&flipped);
            if kept.fault.is_none() {
                assert_eq!(found, sound);
            } else {
                assert_eq!(found, None);
            }
        }
    }
}

#[test]
fn a_blank_flash_holds_nothing_and_garbage_is_a_fault_that_the_next_configuration_ends() {
    let nothing = Kept::default();
    assert_eq!(load(&Flash::new(1)), (None, nothing));
    let mut chance = ChaCha8Rng::seed_from_u64(17);
    for n in 0..100 {
        let mut garbage = Flash::new(n);
        match n % 3 {
            0 => chance.fill(&mut garbage.bytes[..]),
            1 => garbage.bytes.fill(0),
            _ => {
                let at = chance.random_range(0..garbage.bytes.len());
                garbage.bytes[at] = 0xFE;
            }
        }
        let fault = Some(StoreFault::Corrupt);
        assert_eq!(load(&garbage), (None, Kept { writes: 0, fault }));
        keep_well(garbage, &content(n as u32));
    }
}

#[test]
fn a_record_of_another_version_is_told_as_such_and_gives_way() {
    let mut flash = kept(3);
    // The version is the first after the checksum.
    let record = &mut flash.bytes[2 * SLOT..3 * SLOT - WORD];
    record[4] += 1;
    let checksum = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC).checksum(&record[4..]);
    record[..4].copy_from_slice(&checksum.to_le_bytes());
    let fault = Some(StoreFault::Version);
    assert_eq!(load(&flash), (None, Kept { writes: 0, fault }));
    let flash = keep_well(flash, &content(5));
    assert_eq!(load(&flash).1.writes, 4);
}

#[test]
fn a_flash_that_fails_is_told_and_what_was_kept_stays() {
    // The next writing enters a sector.
    let flash = kept(16);
    let before = load(&flash);
    for (fault, told) in [
        (Fault::Read, StoreFault::Flash),
        (Fault::Write, StoreFault::Flash),
        (Fault::Erase, StoreFault::Flash),
        (Fault::Deaf, StoreFault::Verify),
    ] {
        let mut failing = flash.clone();
        failing.fault = fault;
        let (mut after, kept) = keep(failing, &content(16));
        assert_eq!(kept.fault, Some(told), "{fault:?}");
        if fault != Fault::Read {
            assert_eq!(kept.writes, before.1.writes);
        }
        after.fault = Fault::None;
        assert_eq!(load(&after), before, "{fault:?}");
        keep_well(after, &content(16));
    }
}

#[test]
fn a_byte_that_does_not_erase_costs_its_slot() {
    for at in (0..SECTORS * SECTOR).step_by(5 * SLOT / 2 - 1) {
        let mut flash = kept(30);
        flash.fault = Fault::Stuck(at, at + 1);
        for n in 30..200 {
            let (after, told) = keep(flash, &content(n));
            flash = after;
            assert_eq!((told.fault, load(&flash).0), (None, content(n)), "{at}");
        }
    }
}

#[test]
fn a_record_that_is_not_what_was_written_is_told_and_what_was_kept_stays() {
    let flash = kept(3);
    let before = load(&flash);
    let mut told_times = 0;
    for at in 2 * SLOT..4 * SLOT {
        let mut weak = flash.clone();
        weak.fault = Fault::Weak(at);
        let (after, told) = keep(weak, &content(3));
        if told.fault.is_some() {
            assert_eq!(told.fault, Some(StoreFault::Verify));
            assert_eq!(load(&after), before, "{at}");
            told_times += 1;
            // The slot is passed over from then on.
            keep_well(after, &content(3));
        } else {
            assert_eq!(load(&after).0, content(3), "{at}");
        }
    }
    assert!(told_times > 100, "{told_times}");
}

#[test]
fn what_is_kept_stays_when_every_other_sector_is_worn_out() {
    let mut flash = kept(10);
    flash.fault = Fault::Stuck(SECTOR, SECTORS * SECTOR);
    for n in 10..16 {
        flash = keep_well(flash, &content(n));
    }
    let before = load(&flash);
    for n in 16..24 {
        let (after, told) = keep(flash, &content(n));
        assert_eq!(told.fault, Some(StoreFault::Verify));
        assert_eq!(load(&after), before);
        flash = after;
    }
}

#[test]
fn the_longest_configuration_fits() {
    let mut longest = configuration(0);
    longest.configuration.compensation.mode = Some(Mode::Pointwise);
    longest.configuration.compensation.block_samples = u16::MAX;
    longest.provenance = Some(Provenance {
        serial: Name::new(&"x".repeat(NAME)).expect("a name"),
        date: Date {
            year: u16::MAX,
            month: 12,
            day: 31,
        },
        ..provenance(1)
    });
    let record = (u16::MAX, u32::MAX, Some(longest));
    let mut room = [0; SLOT];
    let bytes = postcard::to_slice(&record, &mut room).expect("room").len();
    println!("{bytes} bytes");
    assert!(4 + bytes <= SLOT - WORD, "{bytes}");
}

#[test]
fn a_configuration_that_cannot_be_is_not_kept() {
    let flash = kept(1);
    let mut spoilt = configuration(1);
    spoilt.configuration.compensation.block_samples = 0;
    let (after, kept) = keep(flash.clone(), &Some(spoilt));
    assert_eq!(kept.fault, Some(StoreFault::Corrupt));
    assert_eq!(after.bytes, flash.bytes);
}

#[test]
fn what_is_kept_already_is_not_written_again() {
    for count in [0, 1, 4, 5] {
        let flash = kept(count);
        let before = load(&flash);
        let (after, told) = keep(flash.clone(), &before.0);
        assert_eq!((after.bytes, told), (flash.bytes, before.1), "{count}");
    }
}

#[test]
fn a_sector_is_erased_once_in_sixteen_writings() {
    assert_eq!(kept(256).erasures, 256 / SLOTS_OF_SECTOR);
}
