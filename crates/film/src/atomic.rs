//! Files that appear whole or not at all.

use std::{
    fs,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use crate::FilmError;

/// Writes the file `path` with what `write` puts into the writer, or leaves things as they were.
///
/// The bytes go to a temporary file in the same folder, are flushed to the disk, and then take the
/// name. When `write` or the file system fails, the temporary file is removed and an older file of
/// that name stays untouched. A folder that does not exist is created (and stays, should writing
/// fail). A symbolic link is followed. The new file has the permissions of any new file.
///
/// The writer is buffered.
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

    let mut prefix = std::ffi::OsString::from(".");
    // A name may be as long as the file system allows, so only a part of it goes into the temporary one.
    prefix.push(name.to_string_lossy().chars().take(32).collect::<String>());
    prefix.push(".");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(".tmp");
    #[cfg(unix)]
    {
        // Temporary files are private by default, but this one becomes an ordinary file (the umask still applies).
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(0o666));
    }
    let mut file = builder.tempfile_in(folder)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file.as_file_mut());
    write(&mut writer)?;
    writer.flush()?;
    drop(writer);
    file.as_file().sync_all()?;
    file.persist(&target).map_err(|failed| failed.error)?;
    Ok(())
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
