//! Random numbers: one generator for each purpose, all from the scenario's seed.

use rand_pcg::Pcg64Mcg;
use rand_pcg::rand_core::SeedableRng;

/// Seed of the generator called `name` in a scenario seeded with `seed`.
///
/// Different names give unrelated seeds, so that a node which draws one number more changes nothing elsewhere. The hash
/// is FNV-1a, mixed by the finaliser of SplitMix64.
#[must_use]
pub fn seed_for(seed: u64, name: &str) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325_u64;
    for byte in seed.to_le_bytes().into_iter().chain(name.bytes()) {
        hash = (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
    }
    hash = (hash ^ (hash >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    hash = (hash ^ (hash >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    hash ^ (hash >> 31)
}

/// The generator called `name` in a scenario seeded with `seed`.
#[must_use]
pub fn generator(seed: u64, name: &str) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed_for(seed, name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_seeds_matter() {
        assert_eq!(seed_for(1, "camera"), seed_for(1, "camera"));
        assert_ne!(seed_for(1, "camera"), seed_for(2, "camera"));
        assert_ne!(seed_for(1, "camera"), seed_for(1, "parts"));
    }
}
