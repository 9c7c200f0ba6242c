//! `NAME.state`: an unfinished render, to be continued to the same bits by `--resume`.
//!
//! `manylight state\n`, the version of the format (u32) and the length of the header (u32), little-endian; the
//! header, JSON; the [`Render`]'s own bytes; and a check sum (u64) of all before it. The header says what decides
//! the picture's bits, and a render that differs in any of it is refused by name.

use std::fs::File;
use std::io::{self, BufReader, ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use gather::{Render, Shard};
use scene::Scene;
use serde::{Deserialize, Serialize};

use crate::error::CliError;
use crate::fingerprint::Fnv;
use crate::job::Job;
use crate::report::{self, PassError};

const MAGIC: &[u8; 16] = b"manylight state\n";
const VERSION: u32 = 5;
/// A longer header is none of ours: a pass adds about 100 bytes.
const LONGEST_HEADER: u32 = 1 << 24;

/// What a state is of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Subject(Vec<(String, String)>);

impl Subject {
    /// Everything that decides a picture's bits. Where the scene's files are and how many samples are wanted
    /// does not.
    pub(crate) fn of(job: &Job, scene: &Scene, shard: Shard) -> Self {
        let mut list = vec![
            ("size".to_owned(), format!("{}x{}", job.width, job.height)),
            ("shard".to_owned(), shard.to_string()),
        ];
        let elsewhere = |name: &str| name == "spp" || name == "scene";
        list.extend(
            report::attributes(job, scene, 0)
                .into_iter()
                .filter(|(name, _)| !elsewhere(name)),
        );
        Self(list)
    }

    /// What decides the bits, apart from the program itself: name and value.
    pub(crate) fn content(&self) -> impl Iterator<Item = &(String, String)> {
        let program = |name: &str| name == "version" || name == "commit";
        self.0.iter().filter(move |(name, _)| !program(name))
    }

    /// What differs, in words; `None` when nothing does.
    fn difference(&self, expected: &Self) -> Option<String> {
        let find = |list: &Self, name: &str| {
            let found = list.0.iter().find(|(n, _)| n == name);
            found.map_or("nothing".to_owned(), |(_, value)| value.clone())
        };
        let names = self.0.iter().chain(&expected.0).map(|(name, _)| name);
        names
            .map(|name| (name, find(self, name), find(expected, name)))
            .find(|(_, found, wanted)| found != wanted)
            .map(|(name, found, wanted)| format!("{name} is {found}; expected {wanted}"))
    }
}

#[derive(Debug, Serialize, Deserialize)]
struct Header {
    subject: Subject,
    /// Error after each pass so far.
    passes: Vec<PassError>,
}

/// Writes `render`, which is of `subject`, to `path`.
pub(crate) fn write(
    path: &Path,
    subject: &Subject,
    passes: &[PassError],
    render: &Render<'_>,
) -> Result<(), CliError> {
    let header = Header {
        subject: subject.clone(),
        passes: passes.to_vec(),
    };
    let header = serde_json::to_vec(&header).map_err(io::Error::from);
    film::write_atomically(path, |file| {
        let header = header?;
        let length = u32::try_from(header.len()).map_err(io::Error::other)?;
        let mut file = Summed::new(file);
        file.write_all(MAGIC)?;
        file.write_all(&VERSION.to_le_bytes())?;
        file.write_all(&length.to_le_bytes())?;
        file.write_all(&header)?;
        render.save(&mut file)?;
        let sum = file.sum.0;
        file.write_all(&sum.to_le_bytes())
    })?;
    Ok(())
}

/// A state file that begins as it should.
pub(crate) struct Saved {
    path: PathBuf,
    header: Header,
    file: Summed<BufReader<File>>,
}

/// A render that goes on.
pub(crate) struct Resumed<'a> {
    pub(crate) render: Render<'a>,
    pub(crate) passes: Vec<PassError>,
}

impl Saved {
    /// Opens the state at `path`; `None` when there is nothing.
    ///
    /// # Errors
    /// When it cannot be read or is no state. Nothing large is allocated whatever it holds.
    pub(crate) fn open(path: &Path) -> Result<Option<Self>, CliError> {
        let file = match File::open(path) {
            Ok(file) => file,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(refuse(path, error)),
        };
        let mut file = Summed::new(BufReader::with_capacity(1 << 16, file));
        let header = read_header(&mut file).map_err(|error| refuse(path, error))?;
        Ok(Some(Self {
            path: path.to_owned(),
            header,
            file,
        }))
    }

    /// Gives `render`, which is of `subject`, this state.
    ///
    /// # Errors
    /// When the state is of something else, or is damaged.
    pub(crate) fn resume<'a>(
        mut self,
        subject: &Subject,
        render: Render<'a>,
    ) -> Result<Resumed<'a>, CliError> {
        if let Some(difference) = self.header.subject.difference(subject) {
            return Err(CliError::Input(format!(
                "{}: the state of another render: {difference} (without --resume the render starts anew)",
                self.path.display()
            )));
        }
        let path = self.path;
        let render = render
            .restored(&mut self.file)
            .and_then(|render| read_sum(&mut self.file).map(|()| render))
            .map_err(|error| refuse(&path, error))?;
        Ok(Resumed {
            render,
            passes: self.header.passes,
        })
    }
}

/// Removes the state of a render that is finished.
///
/// # Errors
/// When it is there and stays there.
pub(crate) fn remove(path: &Path) -> Result<(), CliError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(CliError::Input(format!(
            "{}: cannot remove the state of the finished render: {error}",
            path.display()
        ))),
        _ => Ok(()),
    }
}

fn refuse(path: &Path, error: io::Error) -> CliError {
    let reason = match error.kind() {
        ErrorKind::UnexpectedEof => "the file ends early".to_owned(),
        _ => error.to_string(),
    };
    CliError::Input(format!(
        "{}: cannot go on from this state: {reason} (without --resume the render starts anew)",
        path.display()
    ))
}

fn read_header(file: &mut impl Read) -> io::Result<Header> {
    let invalid = |message: String| io::Error::new(ErrorKind::InvalidData, message);
    let mut magic = [0; MAGIC.len()];
    file.read_exact(&mut magic)?;
    if magic != *MAGIC {
        return Err(invalid(
            "it is no state; expected a file that an unfinished render left".into(),
        ));
    }
    let version = read_u32(file)?;
    if version != VERSION {
        return Err(invalid(format!(
            "its format has version {version}; expected {VERSION}"
        )));
    }
    let length = read_u32(file)?;
    if length > LONGEST_HEADER {
        return Err(invalid(format!(
            "its header has {length} bytes; expected at most {LONGEST_HEADER}"
        )));
    }
    let mut header = Vec::new();
    // Grows with what is there, not with what is said to be there.
    file.take(u64::from(length)).read_to_end(&mut header)?;
    if header.len() < length as usize {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    serde_json::from_slice(&header).map_err(|e| invalid(format!("its header is damaged: {e}")))
}

fn read_u32(file: &mut impl Read) -> io::Result<u32> {
    let mut bytes = [0; 4];
    file.read_exact(&mut bytes)?;
    Ok(u32::from_le_bytes(bytes))
}

/// The check sum, and that nothing follows.
fn read_sum(file: &mut Summed<impl Read>) -> io::Result<()> {
    let expected = file.sum.0.to_le_bytes();
    let mut found = [0; 8];
    file.read_exact(&mut found)?;
    let more = file.read(&mut [0])? > 0;
    match found == expected && !more {
        true => Ok(()),
        false => Err(io::Error::new(
            ErrorKind::InvalidData,
            "its check sum is wrong: the file is damaged",
        )),
    }
}

/// Reads or writes, and sums up what goes by.
struct Summed<F> {
    file: F,
    sum: Fnv,
}

impl<F> Summed<F> {
    fn new(file: F) -> Self {
        let sum = Fnv::default();
        Self { file, sum }
    }
}

impl<F: Write> Write for Summed<F> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.sum.bytes(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl<F: Read> Read for Summed<F> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let read = self.file.read(bytes)?;
        self.sum.bytes(&bytes[..read]);
        Ok(read)
    }
}
