//! `--tev HOST:PORT`: the picture in the tev viewer while it is rendered.

use std::io;
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use film::Image;
use tev_client::{PacketCreateImage, PacketUpdateImage, TevClient};

use crate::error::CliError;
use crate::progress::Progress;

const CHANNELS: [&str; 3] = ["R", "G", "B"];
/// A viewer that does not take anything for so long is not waited for any more.
const PATIENCE: Duration = Duration::from_secs(10);
/// Rows are sent together up to so many numbers: a packet tells its own length in 32 bits.
const MOST_NUMBERS: usize = 1 << 22;

/// A viewer that shows one picture.
pub(crate) struct Viewer<'a> {
    address: &'a str,
    /// Name of the picture there.
    name: &'a str,
    /// `None` once the viewer is gone.
    client: Option<TevClient>,
}

impl<'a> Viewer<'a> {
    /// Finds the viewer at `address`, `HOST:PORT`, and gives it a black picture of that size.
    ///
    /// # Errors
    /// When there is none.
    pub(crate) fn connect(
        address: &'a str,
        name: &'a str,
        width: u32,
        height: u32,
    ) -> Result<Self, CliError> {
        let create = PacketCreateImage {
            image_name: name,
            grab_focus: true,
            width,
            height,
            channel_names: &CHANNELS,
        };
        let client = connected(address).and_then(|mut client| {
            client.send(create)?;
            Ok(client)
        });
        let client = client.map_err(|error| {
            CliError::Input(format!(
                "--tev {address}: no viewer there: {error}; expected HOST:PORT where tev listens, 127.0.0.1:14158 \
                 unless it was told otherwise"
            ))
        })?;
        Ok(Self {
            address,
            name,
            client: Some(client),
        })
    }

    /// Shows `image`, of the size that was promised. A viewer that has gone is told of once, and the render goes on.
    pub(crate) fn show(&mut self, image: &Image, progress: &Progress) {
        let Some(client) = &mut self.client else {
            return;
        };
        if let Err(error) = send(client, self.name, image) {
            self.client = None;
            let address = self.address;
            progress.line(&format!(
                "warning: the viewer at {address} is gone ({error}); rendering goes on without it"
            ));
        }
    }
}

fn connected(address: &str) -> io::Result<TevClient> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the host has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, PATIENCE) {
            Ok(socket) => {
                socket.set_write_timeout(Some(PATIENCE))?;
                return Ok(TevClient::wrap(socket));
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

fn send(client: &mut TevClient, name: &str, image: &Image) -> io::Result<()> {
    let width = image.width as usize;
    let rows_at_once = (MOST_NUMBERS / (3 * width)).max(1);
    let bands = image.pixels.chunks(rows_at_once * width);
    for (n, band) in bands.enumerate() {
        let data: Vec<f32> = band.iter().flat_map(|rgb| rgb.to_array()).collect();
        client.send(PacketUpdateImage {
            image_name: name,
            grab_focus: false,
            channel_names: &CHANNELS,
            channel_offsets: &[0, 1, 2],
            channel_strides: &[3, 3, 3],
            x: 0,
            y: (n * rows_at_once) as u32,
            width: image.width,
            height: (band.len() / width) as u32,
            data: &data,
        })?;
    }
    Ok(())
}
