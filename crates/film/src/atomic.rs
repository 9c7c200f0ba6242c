//! Files that appear whole or not at all.

use std::{
    ffi::OsStr,
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use tempfile::NamedTempFile;

use crate::FilmError;

/// Writes the file `path` with what `write` puts into the writer, or leaves things as they were.
///
/// The bytes go to a temporary file in the same folder, are flushed to the disk, and then take the
/// name. When `write` or the file system fails, the temporary file is removed and an older file of
/// that name stays untouched. A folder that does not exist is created (and stays, should writing
/// fail). A symbolic link is followed. The new file has the permissions of any new file.
///
/// The writer is buffered. A process that is killed leaves the temporary file: [`remove_abandoned`].
///
/// # Errors
///
/// [`FilmError::Io`] names `path`; something there that is no regular file (a folder, a device) is
/// refused.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(), FilmError> {
    replace(path, write).map_err(|source| FilmError::Io {
        path: path.display().to_string(),
        source,
    })
}

fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let target = resolve(path)?;
    let name = target
        .file_name()
        .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "the path names no file"))?;
    let folder = match target.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    fs::create_dir_all(folder)?;

    let mut file = temporary(folder, &prefix(name))?;
    let mut writer = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    write(&mut writer)?;
    writer.flush()?;
    drop(writer);
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|failed| failed.error)?;
    Ok(())
}

/// What the names of a file's temporary ones begin with.
fn prefix(name: &OsStr) -> String {
    // A name may be as long as the file system allows, so only a part of it goes into the temporary one.
    let part: String = name.to_string_lossy().chars().take(32).collect();
    format!(".{part}.")
}

const SUFFIX: &str = ".tmp";

/// A new file that is locked, so that nobody takes it for abandoned.
fn temporary(folder: &Path, prefix: &str) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(SUFFIX);
    #[cfg(unix)]
    {
        // Temporary files are private by default, but this one becomes an ordinary file (the umask still applies).
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    loop {
        let file = builder.tempfile_in(folder)?;
        if lock(&file) {
            return Ok(file);
        }
    }
}

/// Locks a new file until it is closed. `false` when somebody removed it before.
#[cfg(unix)]
fn lock(file: &NamedTempFile) -> bool {
    use rustix::fs::{FlockOperation, flock};
    use std::os::unix::fs::MetadataExt;
    // Where files cannot be locked, none is ever found abandoned.
    let _ = flock(file.as_file(), FlockOperation::LockExclusive);
    file.as_file().metadata().is_ok_and(|m| m.nlink() > 0)
}

/// Nothing is ever found abandoned here.
#[cfg(not(unix))]
fn lock(_: &NamedTempFile) -> bool {
    true
}

/// Removes the temporary files that writers of the file `path` left beside it when they were killed. Those of writers
/// that live, in whatever process, are locked and stay; and so do all on systems that are not Unix.
///
/// What cannot be removed stays as well: nothing depends on it.
pub fn remove_abandoned(path: &Path) {
    let Ok(target) = resolve(path) else { return };
    if let (Some(folder), Some(name)) = (target.parent(), target.file_name()) {
        sweep(folder, |start| start == prefix(name));
    }
}

/// [`remove_abandoned`] for all files in `folder`.
pub fn remove_all_abandoned(folder: &Path) {
    sweep(folder, |_| true);
}

/// Removes abandoned files in `folder` whose names begin with a [`prefix`] that `is_own` knows.
fn sweep(folder: &Path, is_own: impl Fn(&str) -> bool) {
    let folder = match folder.as_os_str().is_empty() {
        true => Path::new("."),
        false => folder,
    };
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let start = name.to_str().and_then(start_of_temporary);
        if start.is_some_and(&is_own) && is_abandoned(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// `.NAME.` of a temporary file's name; `None` for other files.
fn start_of_temporary(name: &str) -> Option<&str> {
    // Behind it come six letters and digits.
    let name = name.strip_suffix(SUFFIX)?;
    let (start, random) = name.split_at_checked(name.len().checked_sub(6)?)?;
    let is_random = random.bytes().all(|b| b.is_ascii_alphanumeric());
    let is_start = start.len() > 2 && start.starts_with('.') && start.ends_with('.');
    (is_random && is_start).then_some(start)
}

/// Whether no writer holds the file.
#[cfg(unix)]
fn is_abandoned(path: &Path) -> bool {
    use rustix::fs::{FlockOperation, flock};
    // Links and pipes are none of ours.
    let is_file = fs::symlink_metadata(path).is_ok_and(|m| m.is_file());
    let file = fs::File::open(path).ok().filter(|_| is_file);
    file.is_some_and(|file| flock(&file, FlockOperation::NonBlockingLockExclusive).is_ok())
}

#[cfg(not(unix))]
fn is_abandoned(_: &Path) -> bool {
    false
}

/// The file that a rename must replace: links followed, so that a link to a picture stays one.
fn resolve(path: &Path) -> io::Result<PathBuf> {
    match fs::metadata(path) {
        Ok(found) if found.is_file() => fs::canonicalize(path),
        Ok(_) => Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "there is something there that is no regular file",
        )),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(path.to_path_buf()),
        Err(error) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names_in(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = fs::read_dir(folder)
            .expect("the folder exists")
            .map(|entry| {
                entry
                    .expect("readable")
                    .file_name()
                    .to_string_lossy()
                    .into_owned()
            })
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_missing_folder_is_created() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a/b/c.json");
        write_atomically(&path, |w| w.write_all(b"{}")).expect("writes");
        assert_eq!(fs::read(&path).expect("reads"), b"{}", "contents");
    }

    #[test]
    fn a_failing_writer_leaves_the_old_file_whole_and_nothing_else() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("picture.exr");
        fs::write(&path, b"old").expect("writes");
        let error = write_atomically(&path, |w| {
            w.write_all(&[7; 1 << 20])?;
            Err(io::Error::new(io::ErrorKind::StorageFull, "disk full"))
        })
        .expect_err("the writer failed");
        assert!(
            error.to_string().contains("picture.exr: disk full"),
            "{error}"
        );
        assert_eq!(fs::read(&path).expect("reads"), b"old", "the old file");
        assert_eq!(
            names_in(folder.path()),
            ["picture.exr"],
            "no temporary file is left"
        );
    }

    #[test]
    fn a_failing_writer_leaves_no_file_where_there_was_none() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("new.png");
        write_atomically(&path, |_| Err(io::Error::other("no"))).expect_err("the writer failed");
        assert!(names_in(folder.path()).is_empty(), "nothing is left");
    }

    #[test]
    fn a_folder_in_the_way_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let error = write_atomically(folder.path(), |w| w.write_all(b"x")).expect_err("a folder");
        assert!(error.to_string().contains("no regular file"), "{error}");
        let below_a_file = folder.path().join("file");
        fs::write(&below_a_file, b"x").expect("writes");
        let path = below_a_file.join("picture.exr");
        let error = write_atomically(&path, |w| w.write_all(b"x")).expect_err("below a file");
        assert!(error.to_string().contains("picture.exr"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn what_a_killed_writer_left_is_removed_and_nothing_else() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.exr");
        let others = [
            ".a.exr.b0c1d2.tmp.x",
            ".a.exr.long-0.tmp",
            ".a.exr.more.b0c1d2.tmp",
            ".a.exr.swp",
            ".b.exr.b0c1d2.tmp",
            "a.exr",
        ];
        for name in others.iter().chain(&[".a.exr.b0c1d2.tmp"]) {
            fs::write(folder.path().join(name), b"half").expect("writes");
        }
        remove_abandoned(&path);
        assert_eq!(names_in(folder.path()), others, "only its own is gone");
        remove_all_abandoned(folder.path());
        let left = [
            ".a.exr.b0c1d2.tmp.x",
            ".a.exr.long-0.tmp",
            ".a.exr.swp",
            "a.exr",
        ];
        assert_eq!(names_in(folder.path()), left, "and those of all files");
    }

    #[cfg(unix)]
    #[test]
    fn the_file_of_a_writer_at_work_stays() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("a.exr");
        write_atomically(&path, |to| {
            to.write_all(b"whole")?;
            remove_abandoned(&path);
            remove_all_abandoned(folder.path());
            Ok(())
        })
        .expect("writes");
        assert_eq!(fs::read(&path).expect("reads"), b"whole", "contents");
        assert_eq!(names_in(folder.path()), ["a.exr"], "nothing else");
    }

    #[test]
    fn the_longest_file_name_works() {
        let folder = tempfile::tempdir().expect("temporary folder");
        let path = folder.path().join("x".repeat(255));
        write_atomically(&path, |w| w.write_all(b"x")).expect("writes");
    }

    #[cfg(unix)]
    #[test]
    fn a_link_stays_a_link_and_the_file_is_no_more_private_than_others() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("temporary folder");
        let (file, link) = (folder.path().join("file"), folder.path().join("link"));
        let ordinary = folder.path().join("ordinary");
        fs::write(&ordinary, b"x").expect("writes");
        write_atomically(&file, |w| w.write_all(b"old")).expect("writes");
        std::os::unix::fs::symlink(&file, &link).expect("links");
        write_atomically(&link, |w| w.write_all(b"new")).expect("writes");
        assert!(
            fs::symlink_metadata(&link).expect("there").is_symlink(),
            "the link"
        );
        assert_eq!(
            fs::read(&file).expect("reads"),
            b"new",
            "the file behind it"
        );
        let mode = |path: &Path| fs::metadata(path).expect("there").permissions().mode() & 0o777;
        assert_eq!(mode(&file), mode(&ordinary), "permissions");
    }
}
