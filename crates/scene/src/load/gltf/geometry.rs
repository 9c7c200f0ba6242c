//! Primitives: read once, added to the mesh for each of their instances.

use glam::{DMat3, DVec3, Vec2, Vec3};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;

use super::data::{Data, item};
use super::material::Look;
use super::nodes::{Instance, point};
use crate::load::Parts;
use crate::{ABSENT, MaterialId, Mesh};

/// Triangles that the meshes of all nodes may come to: a small file can name one mesh very often.
const MOST_TRIANGLES: u64 = 1 << 27;

/// Things of the file that are not rendered, and how many there are.
#[derive(Debug, Default)]
pub(super) struct Ignored {
    pub(super) points_and_lines: usize,
    pub(super) morph_targets: usize,
    pub(super) without_coordinates: usize,
}

/// Triangles in the space of their mesh.
struct Shape {
    positions: Vec<[f32; 3]>,
    /// One a position, or empty.
    normals: Vec<[f32; 3]>,
    /// One a position, or empty.
    uvs: Vec<Vec2>,
    /// One a position, or empty.
    colours: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    material: MaterialId,
}

/// Adds all instances to `parts.mesh`, mesh by mesh.
pub(super) fn read(
    parts: &mut Parts,
    data: &Data<'_>,
    looks: &[Look],
    instances: &[Instance],
) -> Result<Ignored, String> {
    refuse_too_many(data, instances, parts.mesh.len())?;
    let mut ignored = Ignored::default();
    let mut order: Vec<&Instance> = instances.iter().collect();
    order.sort_by_key(|instance| instance.mesh);
    for same in order.chunk_by(|a, b| a.mesh == b.mesh) {
        let index = same[0].mesh;
        let mesh = item(&data.root.meshes, index, "nodes: mesh")?;
        for (k, primitive) in mesh.primitives.iter().enumerate() {
            let field = format!("meshes[{index}].primitives[{k}]");
            let Some(shape) = shape(data, looks, primitive, &field, &mut ignored)? else {
                continue;
            };
            let first = Shared {
                uv: length(parts.mesh.uvs.len())?,
                colour: length(parts.mesh.colours.len())?,
            };
            parts.mesh.uvs.extend(&shape.uvs);
            parts.mesh.colours.extend(&shape.colours);
            for instance in same {
                append(parts, &shape, first, instance)?;
            }
        }
    }
    Ok(ignored)
}

/// Counts before anything is allocated.
fn refuse_too_many(data: &Data<'_>, instances: &[Instance], before: usize) -> Result<(), String> {
    let root = data.root;
    let mut corners = 0u64;
    for instance in instances {
        let field = format!("nodes[{}].mesh", instance.node);
        for primitive in &item(&root.meshes, instance.mesh, &field)?.primitives {
            let positions = primitive
                .attributes
                .get(&Checked::Valid(Semantic::Positions));
            let accessor = primitive.indices.or(positions.copied());
            let accessor = accessor.and_then(|a| root.accessors.get(a.value()));
            let each = match primitive.mode {
                Checked::Valid(Mode::TriangleStrip | Mode::TriangleFan) => 3,
                _ => 1,
            };
            let count = accessor.map_or(0, |accessor| accessor.count.0);
            corners = corners.saturating_add(count.saturating_mul(each));
        }
    }
    let triangles = (corners / 3).saturating_add(before as u64);
    match triangles <= MOST_TRIANGLES {
        true => Ok(()),
        false => Err(format!(
            "the nodes' meshes come to {triangles} triangles; expected at most {MOST_TRIANGLES}"
        )),
    }
}

fn shape(
    data: &Data<'_>,
    looks: &[Look],
    primitive: &Primitive,
    field: &str,
    ignored: &mut Ignored,
) -> Result<Option<Shape>, String> {
    let attribute = |semantic| {
        let accessor = primitive.attributes.get(&Checked::Valid(semantic));
        accessor.map(|accessor| accessor.value())
    };
    let mode = match primitive.mode {
        Checked::Valid(mode @ (Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)) => mode,
        Checked::Valid(_) => {
            ignored.points_and_lines += 1;
            return Ok(None);
        }
        Checked::Invalid => return Err(format!("{field}.mode: expected 0 to 6")),
    };
    ignored.morph_targets += usize::from(primitive.targets.is_some());
    let look = match primitive.material {
        Some(material) => Some(item(looks, material.value(), &format!("{field}.material"))?),
        None => None,
    };

    let at = |name: &str| format!("{field}.attributes.{name}");
    let positions =
        attribute(Semantic::Positions).ok_or_else(|| format!("{} is missing", at("POSITION")))?;
    let positions = data.vectors::<3>(positions, &at("POSITION"))?;
    let as_many = |found: usize, name: &str| match found == positions.len() {
        true => Ok(()),
        false => Err(format!(
            "{}: found {found} elements; expected {}, as many as positions",
            at(name),
            positions.len()
        )),
    };
    let normals = match attribute(Semantic::Normals) {
        Some(normals) => data.vectors::<3>(normals, &at("NORMAL"))?,
        None => Vec::new(),
    };
    if attribute(Semantic::Normals).is_some() {
        as_many(normals.len(), "NORMAL")?;
    }
    let mut uvs = Vec::new();
    if let Some(coordinates) = look.and_then(|look| look.coordinates) {
        match attribute(Semantic::TexCoords(coordinates.set)) {
            Some(accessor) => {
                let name = format!("TEXCOORD_{}", coordinates.set);
                let found = data.vectors::<2>(accessor, &at(&name))?;
                as_many(found.len(), &name)?;
                uvs.extend(found.into_iter().map(|uv| coordinates.apply(uv)));
            }
            None => ignored.without_coordinates += 1,
        }
    }
    let colours = match attribute(Semantic::Colors(0)) {
        Some(colours) => data.colours(colours, &at("COLOR_0"))?,
        None => Vec::new(),
    };
    if attribute(Semantic::Colors(0)).is_some() {
        as_many(colours.len(), "COLOR_0")?;
    }
    let corners = match primitive.indices {
        Some(accessor) => data.indices(accessor.value(), &format!("{field}.indices"))?,
        None => (0..length(positions.len())?).collect(),
    };
    if let Some(&wrong) = corners.iter().find(|&&i| i as usize >= positions.len()) {
        let count = positions.len();
        return Err(format!(
            "{field}.indices: found {wrong}; expected less than {count}"
        ));
    }
    let triangles = match mode {
        Mode::TriangleStrip => {
            let strip = corners.windows(3).enumerate();
            strip
                .map(|(i, c)| match i % 2 {
                    0 => [c[0], c[1], c[2]],
                    _ => [c[1], c[0], c[2]],
                })
                .collect()
        }
        Mode::TriangleFan => {
            let edges = corners.get(1..).unwrap_or_default().windows(2);
            edges.map(|edge| [corners[0], edge[0], edge[1]]).collect()
        }
        _ => {
            if !corners.len().is_multiple_of(3) {
                let count = corners.len();
                return Err(format!(
                    "{field}: found {count} corners of triangles; expected a multiple of 3"
                ));
            }
            corners.as_chunks().0.to_vec()
        }
    };
    Ok(Some(Shape {
        positions,
        normals,
        uvs,
        colours,
        triangles,
        material: look.map_or(MaterialId::default(), |look| look.id),
    }))
}

/// Where in the mesh what all instances of a shape share begins.
#[derive(Clone, Copy)]
struct Shared {
    uv: u32,
    colour: u32,
}

/// Adds `shape` as `instance` places it.
fn append(
    parts: &mut Parts,
    shape: &Shape,
    first: Shared,
    instance: &Instance,
) -> Result<(), String> {
    let Mesh {
        positions,
        normals,
        indices,
        normal_indices,
        uv_indices,
        colour_indices,
        materials,
        ..
    } = &mut parts.mesh;
    let first_position = length(positions.len())?;
    let first_normal = length(normals.len())?;
    let matrix = instance.transform.matrix3;
    let field = format!("nodes[{}]", instance.node);
    positions.reserve(shape.positions.len());
    for &p in &shape.positions {
        let p = instance
            .transform
            .transform_point3(Vec3::from(p).as_dvec3());
        positions.push(point(p, &field)?);
    }
    // What mirrors turns triangles inside out.
    let mirrored = matrix.determinant() < 0.0;
    let to_world = normal_matrix(&matrix, mirrored);
    normals.extend(shape.normals.iter().map(|&n| {
        let n = to_world * Vec3::from(n).as_dvec3();
        n.normalize_or_zero().as_vec3()
    }));
    let new_normals = &normals[first_normal as usize..];
    parts.notes.zero_normals += new_normals.iter().filter(|n| **n == Vec3::ZERO).count();
    let is_unit = |corner: &[u32; 3]| {
        !new_normals.is_empty()
            && corner
                .iter()
                .all(|&i| new_normals[i as usize] != Vec3::ZERO)
    };
    for list in [&mut *indices, &mut *normal_indices, &mut *uv_indices] {
        list.reserve(shape.triangles.len());
    }
    let tinted = !shape.colours.is_empty();
    if tinted {
        // Few files have colours: their array is there from the first triangle with one on.
        colour_indices.resize(indices.len(), [ABSENT; 3]);
        colour_indices.reserve(shape.triangles.len());
    }
    for &[a, b, c] in &shape.triangles {
        let corners = if mirrored { [a, c, b] } else { [a, b, c] };
        indices.push(corners.map(|i| first_position + i));
        normal_indices.push(match is_unit(&corners) {
            true => corners.map(|i| first_normal + i),
            false => [ABSENT; 3],
        });
        uv_indices.push(match shape.uvs.is_empty() {
            true => [ABSENT; 3],
            false => corners.map(|i| first.uv + i),
        });
        if tinted {
            colour_indices.push(corners.map(|i| first.colour + i));
        }
        materials.push(shape.material);
    }
    Ok(())
}

/// What takes normals along: the transposed inverse up to a factor, which also exists where a scale is 0.
fn normal_matrix(matrix: &DMat3, mirrored: bool) -> DMat3 {
    let (x, y, z): (DVec3, DVec3, DVec3) = (matrix.x_axis, matrix.y_axis, matrix.z_axis);
    let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if mirrored { -cofactors } else { cofactors }
}

/// A count that leaves room for indices; else a message.
fn length(count: usize) -> Result<u32, String> {
    let most = u32::MAX / 2;
    let count = u32::try_from(count).ok().filter(|&count| count <= most);
    count.ok_or_else(|| format!("there are too many vertices; expected at most {most}"))
}
