//! Campaigns whose effect is withheld until the diagnosis is made.
//!
//! `label.sealed` holds the encrypted truth, a commitment to it and to the campaign's files, and is written with the
//! campaign; `label.key` opens it. Opening asks for a diagnosis of this campaign on disk, and writes that diagnosis's
//! fingerprint beside the truth.
//!
//! What that protects from: reading the label by accident, changing it or the campaign afterwards, swapping the diagnosis
//! once the truth is known. What it does not: whoever has the folder has the key; give `label.key` to somebody else where
//! that matters.

use std::path::Path;

use chacha20poly1305::aead::{Aead, KeyInit, Payload};
use chacha20poly1305::{ChaCha20Poly1305, Key, Nonce};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::campaign::Campaign;
use crate::error::Error;
use crate::input::read_at_most;
use crate::output::write_file;

/// File of the sealed label in a campaign folder.
pub const SEALED: &str = "label.sealed";
const KEY: &str = "label.key";
const FORMAT: &str = "vre-sealed/1";
const OPENED: &str = "truth.json";

/// Files that the seal vouches for.
const VOUCHED: [&str; 4] = [
    "campaign.toml",
    "static.csv",
    "vibration.csv",
    "holdout.csv",
];

/// Largest file that is read as a whole.
const MAX_BYTES: u64 = 1 << 28;

#[derive(Debug, Serialize, Deserialize)]
struct Sealed {
    format: String,
    /// SHA-256 of the campaign's files, hexadecimal.
    campaign_sha256: String,
    /// Nonce of the cipher, hexadecimal.
    nonce: String,
    /// The truth by ChaCha20-Poly1305 with the campaign's fingerprint as associated data, hexadecimal.
    label: String,
}

/// The truth behind a sealed campaign, as it is written on opening.
#[derive(Debug, Serialize)]
pub struct Opened {
    /// Always `vre-unsealed/1`.
    pub format: &'static str,
    /// SHA-256 of the diagnosis that was on disk first, hexadecimal.
    pub diagnosis_sha256: String,
    /// The truth, `vre-truth/1`.
    pub truth: serde_json::Value,
}

/// Randomness of the operating system.
///
/// # Errors
/// It has none to give.
pub fn entropy<const N: usize>() -> Result<[u8; N], Error> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes)
        .map_err(|error| Error::Usage(format!("the operating system gives no entropy: {error}")))?;
    Ok(bytes)
}

/// Seals `truth` into the campaign folder.
///
/// # Errors
/// What the file system or the operating system's entropy says.
pub fn seal(folder: &Path, truth: &impl Serialize) -> Result<(), Error> {
    let file = folder.join(SEALED);
    let text = serde_json::to_vec(truth)
        .map_err(|error| Error::write(&file)(std::io::Error::other(error)))?;
    let (key, nonce) = (entropy::<32>()?, entropy::<12>()?);
    let campaign_sha256 = fingerprint(folder)?;
    let payload = Payload {
        msg: &text,
        aad: campaign_sha256.as_bytes(),
    };
    let label = ChaCha20Poly1305::new(&Key::from(key))
        .encrypt(&Nonce::from(nonce), payload)
        .map_err(|_| Error::Usage("the label is too long to be sealed".into()))?;
    let sealed = Sealed {
        format: FORMAT.into(),
        campaign_sha256,
        nonce: hex(&nonce),
        label: hex(&label),
    };
    crate::output::write_json(&file, &sealed)?;
    write_file(&folder.join(KEY), (hex(&key) + "\n").as_bytes())
}

/// Opens the seal of a campaign folder, after a diagnosis of this campaign is on disk, and writes `truth.json`.
///
/// # Errors
/// No seal or no key, a diagnosis of another instrument or none, or anything changed since the sealing.
pub fn unseal(folder: &Path, diagnosis: &Path) -> Result<Opened, Error> {
    let campaign = Campaign::read(folder)?;
    let diagnosed = read_at_most(diagnosis, MAX_BYTES)?;
    check_diagnosis(diagnosis, &diagnosed, &campaign.config.instrument.serial)?;

    let file = folder.join(SEALED);
    let broken = |what: &str| Error::input(&file, format!("{what}; this seal does not open"));
    let sealed: Sealed = serde_json::from_slice(&read_at_most(&file, MAX_BYTES)?)
        .map_err(|error| broken(&error.to_string()))?;
    if sealed.format != FORMAT {
        return Err(broken("is not of the format vre-sealed/1"));
    }
    if sealed.campaign_sha256 != fingerprint(folder)? {
        return Err(broken(
            "the campaign's files have changed since they were sealed",
        ));
    }
    let key_file = folder.join(KEY);
    let key_text = String::from_utf8_lossy(&read_at_most(&key_file, MAX_BYTES)?).into_owned();
    let key: [u8; 32] = from_hex(key_text.trim())
        .and_then(|bytes| bytes.try_into().ok())
        .ok_or_else(|| Error::input(&key_file, "is not a key of 64 hexadecimal digits"))?;
    let nonce: [u8; 12] = from_hex(&sealed.nonce)
        .and_then(|bytes| bytes.try_into().ok())
        .ok_or_else(|| broken("nonce is not 24 hexadecimal digits"))?;
    let label = from_hex(&sealed.label).ok_or_else(|| broken("label is not hexadecimal"))?;
    let payload = Payload {
        msg: &label,
        aad: sealed.campaign_sha256.as_bytes(),
    };
    let text = ChaCha20Poly1305::new(&Key::from(key))
        .decrypt(&Nonce::from(nonce), payload)
        .map_err(|_| broken("the label has been changed, or the key is another's"))?;
    let truth = serde_json::from_slice(&text).map_err(|error| broken(&error.to_string()))?;
    let opened = Opened {
        format: "vre-unsealed/1",
        diagnosis_sha256: hex(&Sha256::digest(&diagnosed)),
        truth,
    };
    crate::output::write_json(&folder.join(OPENED), &opened)?;
    Ok(opened)
}

/// A diagnosis counts if it is one, of this instrument, with a verdict.
fn check_diagnosis(file: &Path, content: &[u8], serial: &str) -> Result<(), Error> {
    #[derive(Deserialize)]
    struct Head {
        format: String,
        serial: String,
        #[serde(rename = "verdict")]
        _verdict: String,
    }
    let head: Head = serde_json::from_slice(content)
        .map_err(|error| Error::input(file, format!("is no diagnosis: {error}")))?;
    if head.format != "vre-diagnosis/1" {
        return Err(Error::input(file, "is not of the format vre-diagnosis/1"));
    }
    if head.serial != serial {
        let problem = format!(
            "is of the instrument {}, the campaign of {serial}",
            head.serial
        );
        return Err(Error::input(file, problem));
    }
    Ok(())
}

/// SHA-256 over names, lengths and contents of the campaign's files, hexadecimal.
fn fingerprint(folder: &Path) -> Result<String, Error> {
    let mut hash = Sha256::new();
    for name in VOUCHED {
        let content = read_at_most(&folder.join(name), MAX_BYTES)?;
        hash.update(name.as_bytes());
        hash.update((content.len() as u64).to_le_bytes());
        hash.update(&content);
    }
    Ok(hex(&hash.finalize()))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn from_hex(text: &str) -> Option<Vec<u8>> {
    if !text.is_ascii() || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len())
        .step_by(2)
        .map(|k| u8::from_str_radix(&text[k..k + 2], 16).ok())
        .collect()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;
    use crate::bench::noise::Seed;
    use crate::bench::plan::Static;
    use crate::bench::simulate::{Specification, VirtualBench};
    use crate::campaign::write_runs;

    /// A sealed campaign's folder, its truth, and a file with a diagnosis of that serial number.
    fn sealed(diagnosed_serial: Option<&str>) -> (tempfile::TempDir, serde_json::Value) {
        let specification = Specification::with_dial_sigma(1.0);
        let simulation =
            VirtualBench::new(Seed(8), Static::Paper, specification, Vec::new()).simulate();
        let folder = tempfile::tempdir().unwrap();
        simulation.campaign.write(folder.path()).unwrap();
        write_runs(&folder.path().join("holdout.csv"), &simulation.holdout).unwrap();
        seal(folder.path(), &simulation.truth).unwrap();
        let serial = diagnosed_serial.unwrap_or(&simulation.truth.serial);
        let diagnosis = serde_json::json!({
            "format": "vre-diagnosis/1", "serial": serial, "verdict": "no-gap"
        });
        fs::write(folder.path().join("diagnosis.json"), diagnosis.to_string()).unwrap();
        (folder, serde_json::to_value(&simulation.truth).unwrap())
    }

    fn open(folder: &Path) -> Result<Opened, Error> {
        unseal(folder, &folder.join("diagnosis.json"))
    }

    #[test]
    fn what_was_sealed_comes_out_after_the_diagnosis() {
        let (folder, truth) = sealed(None);
        let opened = open(folder.path()).unwrap();
        assert!(opened.truth == truth);
        assert!(folder.path().join("truth.json").exists());
    }

    #[test]
    fn without_a_diagnosis_of_this_instrument_nothing_opens() {
        let (folder, _) = sealed(Some("another"));
        assert_eq!(open(folder.path()).unwrap_err().exit_status(), 2);
        fs::remove_file(folder.path().join("diagnosis.json")).unwrap();
        assert_eq!(open(folder.path()).unwrap_err().exit_status(), 2);
        assert!(!folder.path().join("truth.json").exists());
    }

    #[test]
    fn a_changed_campaign_label_or_key_does_not_open() {
        for file in ["static.csv", "label.sealed", "label.key"] {
            let (folder, _) = sealed(None);
            let path = folder.path().join(file);
            let mut content = fs::read(&path).unwrap();
            // The last digit of the file, before line ends, quotes and braces.
            let last = content
                .iter()
                .rposition(|byte| byte.is_ascii_hexdigit())
                .unwrap();
            content[last] = if content[last] == b'1' { b'2' } else { b'1' };
            fs::write(&path, content).unwrap();
            assert_eq!(open(folder.path()).unwrap_err().exit_status(), 2, "{file}");
        }
    }
}
