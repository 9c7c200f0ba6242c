//! Which nodes of a binary tree a wide one is made of: those that cost rays least.
//!
//! Source: Ylitie, Karras, Laine 2017, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide BVHs", §3.1.

use obvhs::bvh2::Bvh2;

use super::bvh8::WIDTH;
use super::triangle::BLOCK;

/// What a block of triangles costs a ray, in times of a node.
const BLOCK_COST: f32 = 2.0;

/// For each node of a binary tree what rays pay for it when up to so many nodes of the wide one take its place.
pub(super) struct Forests(Vec<Forest>);

#[derive(Debug, Clone, Copy)]
struct Forest {
    /// Triangles below.
    triangles: u32,
    /// Whether it is a block, rather than a wide node, when it is one of them.
    is_block: bool,
    /// Least cost of one.
    one: f32,
    /// Least costs of two, two or three, and so on, all below it; infinite for a leaf.
    below: [f32; WIDTH - 1],
    /// So many of them are below its first child; 0 where one less is no worse.
    firsts: [u8; WIDTH - 1],
}

impl Forest {
    /// Least cost of up to `n` ≥ 1.
    fn cost(&self, n: usize) -> f32 {
        match n {
            1 => self.one,
            _ => self.one.min(self.below[n - 2]),
        }
    }
}

impl Forests {
    /// `triangles` says how many a leaf has.
    pub(super) fn of(binary: &Bvh2, triangles: impl Fn(u32) -> u32) -> Self {
        let leaf = Forest {
            triangles: 0,
            is_block: true,
            one: 0.0,
            below: [f32::INFINITY; WIDTH - 1],
            firsts: [0; WIDTH - 1],
        };
        let mut forests = vec![leaf; binary.nodes.len()];
        // Parents before children. A chain may be deeper than the thread's stack.
        let mut order = Vec::with_capacity(binary.nodes.len());
        let mut work = vec![0u32];
        while let Some(at) = work.pop() {
            order.push(at);
            let node = &binary.nodes[at as usize];
            if !node.is_leaf() {
                work.extend([node.first_index, node.first_index + 1]);
            }
        }
        for at in order.into_iter().rev() {
            let node = &binary.nodes[at as usize];
            let area = node.aabb().half_area();
            let mut forest = leaf;
            if node.is_leaf() {
                forest.triangles = triangles(at);
                let blocks = forest.triangles.div_ceil(BLOCK as u32);
                forest.one = area * BLOCK_COST * blocks as f32;
            } else {
                let first = node.first_index as usize;
                forest.join(&forests[first], &forests[first + 1], area);
            }
            forests[at as usize] = forest;
        }
        Self(forests)
    }

    /// Whether no wide node takes the place of `node`.
    pub(super) fn is_block(&self, node: u32) -> bool {
        self.0[node as usize].is_block
    }

    /// What the children of the wide node are that takes the place of `node`: up to eight nodes below it, or itself if it is a
    /// block.
    pub(super) fn members(&self, binary: &Bvh2, node: u32) -> Vec<u32> {
        if self.is_block(node) {
            return vec![node];
        }
        let mut members = Vec::with_capacity(WIDTH);
        let mut work = vec![(node, WIDTH, true)];
        while let Some((node, mut n, is_open)) = work.pop() {
            let forest = &self.0[node as usize];
            if !is_open && (n == 1 || forest.one <= forest.below[n - 2]) {
                members.push(node);
                continue;
            }
            while forest.firsts[n - 2] == 0 {
                n -= 1;
            }
            let k = forest.firsts[n - 2] as usize;
            let first = binary.nodes[node as usize].first_index;
            work.extend([(first + 1, n - k, false), (first, k, false)]);
        }
        members
    }
}

impl Forest {
    /// Fills in what follows from two children; `area` is that of the box around both.
    fn join(&mut self, a: &Self, b: &Self, area: f32) {
        self.triangles = a.triangles + b.triangles;
        // Also where boxes are so large that all costs are infinite there is a way to divide them.
        let mut best = (a.one + b.one, 1);
        for n in 2..=WIDTH {
            for k in 1..n {
                let cost = a.cost(k) + b.cost(n - k);
                if cost < best.0 {
                    best = (cost, k as u8);
                }
            }
            (self.below[n - 2], self.firsts[n - 2]) = best;
            best.1 = 0;
        }
        let wide = self.below[WIDTH - 2] + area;
        let block = area * BLOCK_COST;
        self.is_block = self.triangles as usize <= BLOCK && block <= wide;
        self.one = if self.is_block { block } else { wide };
    }
}
