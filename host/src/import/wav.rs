//! WAV, by hound: integers are counts of the converter, numbers with a point are as they stand.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use hound::{Sample, SampleFormat, WavIntoSamples, WavReader};

use super::channels::{Channel, Channels, Clock, Head, Wanted};
use crate::error::Error;

/// Frames of a block.
const BLOCK: usize = 1 << 14;

/// Opens a WAV file; its channels are called by their numbers, `1`, `2` and so on.
///
/// # Errors
/// Unreadable, or samples of another kind than integers to 32 bits and 32-bit floating point.
pub(super) fn open(file: &Path, wanted: Wanted<'_>) -> Result<Channels, Error> {
    let source = File::open(file).map_err(Error::read(file))?;
    let bad = |error: hound::Error| {
        let problem = match error {
            hound::Error::Unsupported => {
                "holds samples of a kind that is not read: 16, 24 and 32 bit and 32-bit floating point are".into()
            }
            error => format!("is a damaged WAV file: {error}"),
        };
        Error::input(file, problem)
    };
    let reader = WavReader::new(BufReader::new(source)).map_err(bad)?;
    let spec = reader.spec();
    if spec.sample_rate == 0 || spec.channels == 0 {
        return Err(Error::input(file, "states no sample rate or no channel"));
    }
    let unit = (spec.sample_format == SampleFormat::Int).then(|| "counts".to_owned());
    let heads: Vec<Head> = (1..=spec.channels)
        .map(|number| Head {
            name: number.to_string(),
            unit: unit.clone(),
        })
        .collect();
    let frames = Frames {
        file: file.into(),
        clock: Clock::Rate {
            hz: f64::from(spec.sample_rate),
            start_s: 0.0,
        },
        wanted: heads.iter().map(|head| wanted.has(&head.name)).collect(),
        heads: heads.clone(),
        passed: 0,
        length: u64::from(reader.duration()),
    };
    if frames.length == 0 {
        return Err(Error::input(file, "holds no samples"));
    }
    let blocks: super::channels::Blocks = match spec.sample_format {
        SampleFormat::Int => Box::new(frames.blocks(reader.into_samples::<i32>(), f64::from)),
        SampleFormat::Float => Box::new(frames.blocks(reader.into_samples::<f32>(), f64::from)),
    };
    Ok(Channels {
        heads,
        blocks,
        remark: None,
    })
}

/// Where in the file one is.
struct Frames {
    file: PathBuf,
    clock: Clock,
    heads: Vec<Head>,
    wanted: Vec<bool>,
    passed: u64,
    length: u64,
}

impl Frames {
    fn blocks<S: Sample>(
        mut self,
        mut samples: WavIntoSamples<BufReader<File>, S>,
        number: impl Fn(S) -> f64,
    ) -> impl Iterator<Item = Result<Vec<Channel>, Error>> {
        std::iter::from_fn(move || {
            let count = (self.length - self.passed).min(BLOCK as u64);
            (count > 0).then(|| self.block(&mut samples, count as usize, &number))
        })
    }

    fn block<S: Sample>(
        &mut self,
        samples: &mut WavIntoSamples<BufReader<File>, S>,
        count: usize,
        number: impl Fn(S) -> f64,
    ) -> Result<Vec<Channel>, Error> {
        let mut columns = vec![Vec::new(); self.heads.len()];
        for _ in 0..count {
            for column in &mut columns {
                let Some(Ok(sample)) = samples.next() else {
                    let (passed, length) = (self.passed, self.length);
                    self.passed = self.length;
                    let problem =
                        format!("is cut off: it states {length} frames and ends after {passed}");
                    return Err(Error::input(&self.file, problem));
                };
                column.push(number(sample));
            }
            self.passed += 1;
        }
        let all = self.heads.iter().zip(columns).zip(&self.wanted);
        let kept = all.filter(|(_, wanted)| **wanted);
        Ok(kept
            .map(|((head, values), _)| Channel {
                name: head.name.clone(),
                unit: head.unit.clone(),
                clock: self.clock.clone(),
                values,
            })
            .collect())
    }
}
