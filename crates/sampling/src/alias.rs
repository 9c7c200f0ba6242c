//! Weighted choice among many in constant time.

/// A discrete distribution that is sampled with one look-up, whatever its size.
///
/// Twice the memory of [`Discrete`](crate::Discrete), and neighbouring random numbers lead to unrelated indices:
/// for one distribution that serves a whole picture. All arithmetic is f64, as sums of a million weights need it.
///
/// Source: Vose 1991, "A Linear Algorithm for Generating Random Numbers with a Given Distribution".
#[derive(Debug, Clone)]
pub struct AliasTable {
    columns: Vec<Column>,
    pmf: Vec<f64>,
}

/// An equal share of [0, 1) given to at most two indices.
#[derive(Debug, Clone, Copy)]
struct Column {
    /// Share of the column that is its own index'; the rest is `alias`'.
    own: f64,
    alias: u32,
}

impl AliasTable {
    /// Distribution over the indices of `weights`, each finite and not negative.
    ///
    /// `None` when nothing can be chosen: no weights, or all zero.
    ///
    /// # Panics
    /// When a weight is negative or not finite, or there are more than 2³² of them.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut pmf: Vec<f64> = weights.into_iter().collect();
        assert!(
            pmf.iter().all(|w| *w >= 0.0 && w.is_finite()),
            "a weight is not finite and >= 0"
        );
        let n = u32::try_from(pmf.len()).expect("at most 2^32 weights");
        // In blocks: what a sum of a million rounds off is found again in one column.
        let total: f64 = pmf.chunks(1024).map(|c| c.iter().sum::<f64>()).sum();
        if total <= 0.0 {
            return None;
        }
        for p in &mut pmf {
            *p /= total;
        }
        let heaviest = (0..n).reduce(|a, b| {
            if pmf[b as usize] > pmf[a as usize] {
                b
            } else {
                a
            }
        })?;
        let mut columns: Vec<Column> = pmf
            .iter()
            .map(|p| Column {
                own: p * f64::from(n),
                alias: heaviest,
            })
            .collect();
        let (mut small, mut large): (Vec<u32>, Vec<u32>) =
            (0..n).partition(|&i| columns[i as usize].own < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            columns[s as usize].alias = l;
            // (rest + own) − 1 in this order keeps what rounding takes smallest.
            let rest = (columns[l as usize].own + columns[s as usize].own) - 1.0;
            columns[l as usize].own = rest;
            if rest < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // What is left is full but for rounding. Only an index with weight may have the whole column.
        for i in small.into_iter().chain(large) {
            if pmf[i as usize] > 0.0 {
                columns[i as usize].own = 1.0;
            }
        }
        Some(Self { columns, pmf })
    }

    /// Probability of index `i`.
    pub fn pmf(&self, i: usize) -> f64 {
        self.pmf[i]
    }

    /// The index that `u` in [0, 1) falls on; never one of zero weight.
    pub fn sample(&self, u: f64) -> usize {
        let scaled = u * self.columns.len() as f64;
        let i = (scaled as usize).min(self.columns.len() - 1);
        let column = self.columns[i];
        if scaled - (i as f64) < column.own {
            i
        } else {
            column.alias as usize
        }
    }

    /// Heap memory in bytes.
    pub fn bytes(&self) -> usize {
        self.columns.len() * (size_of::<Column>() + size_of::<f64>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of [0, 1) that leads to each index, from the columns.
    fn shares(table: &AliasTable) -> Vec<f64> {
        let mut shares = vec![0.0; table.columns.len()];
        for (i, column) in table.columns.iter().enumerate() {
            let own = column.own.clamp(0.0, 1.0);
            shares[i] += own;
            shares[column.alias as usize] += 1.0 - own;
        }
        let n = shares.len() as f64;
        shares.into_iter().map(|s| s / n).collect()
    }

    fn sets() -> Vec<Vec<f64>> {
        let mut rng = crate::Rng::new(3, 0, 0, crate::Purpose::Build);
        let mut uneven: Vec<f64> = (0..1000).map(|_| rng.f64().powi(20)).collect();
        uneven[17] = 0.0;
        vec![
            vec![1.0],
            vec![0.0, 2.0, 0.0],
            vec![1.0, 3.0],
            vec![0.1; 7],
            vec![1e-300, 1e300, 1.0],
            vec![5e-324; 3],
            uneven,
        ]
    }

    #[test]
    fn every_index_has_its_share() {
        for weights in sets() {
            let total: f64 = weights.iter().sum();
            let table = AliasTable::new(weights.iter().copied()).expect("has weight");
            for (i, share) in shares(&table).into_iter().enumerate() {
                let p = weights[i] / total;
                assert!((share - p).abs() < 1e-13, "{i} has {share} of {p}");
                assert!((table.pmf(i) - p).abs() <= 1e-14 * p, "pmf of {i}");
                assert!(weights[i] > 0.0 || share == 0.0, "{i} has no weight");
            }
        }
    }

    #[test]
    fn zero_weights_are_never_chosen() {
        for weights in sets() {
            let table = AliasTable::new(weights.iter().copied()).expect("has weight");
            let n = weights.len() as f64;
            for i in 0..weights.len() {
                for within in [0.0, 0.3, 1.0 - 1e-9] {
                    let u = ((i as f64 + within) / n).min(1.0 - f64::EPSILON / 2.0);
                    let chosen = table.sample(u);
                    assert!(weights[chosen] > 0.0, "u = {u} chose {chosen}");
                }
            }
        }
    }

    #[test]
    fn nothing_to_choose_is_none() {
        assert!(AliasTable::new([]).is_none(), "no weights");
        assert!(AliasTable::new([0.0, 0.0]).is_none(), "all zero");
    }

    #[test]
    fn a_million_weights_keep_their_shares() {
        let n = 1_000_000;
        let table = AliasTable::new((0..n).map(|i| if i == 0 { 1e9 } else { 1e-3 + f64::from(i) }))
            .expect("has weight");
        for (i, share) in shares(&table).into_iter().enumerate() {
            let p = table.pmf(i);
            assert!(
                (share - p).abs() < 1e-10 * p + 1e-16,
                "{i} has {share} of {p}"
            );
        }
    }
}
