//! A short walk with the targets that fuzzers run for longer: good input, damaged in every way, and noise.

use feeder_runtime::fuzzing::TARGETS;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Inputs for each target, unless `FUZZ_INPUTS` says otherwise; with `FUZZ_SEED` they are others.
const INPUTS: u64 = 20_000;
/// Good bodies of all message types.
const MESSAGES: &str = include_str!("../../../../msgs/tests/data/cdr.txt");
const PARAMETERS: &str = "/**:\n  ros__parameters: {seed: 1, gains: [1.0, 2.5], deep: {on: yes, name: 'a b'}}\n/feeder/*:\n  ros__parameters:\n    x: -3\n";
const ARGUMENTS: &str =
    "-r\nwaveform:=/w\n-p\ncourier_driver:rate:=[1, 2]\n--log-level\na.b:=debug\n-r\n__ns:=/two\n--enclave\n/a\n";

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

/// Good input, as far as one can tell for all targets at once.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let bodies = || MESSAGES.lines().map(|line| bytes(&line.split_once(' ').unwrap().1[8..]));
    match target {
        "params_file" => vec![PARAMETERS.into()],
        "ros_args" => vec![ARGUMENTS.into()],
        // The first two bytes choose the type and the byte order.
        "cdr" => (0..).zip(bodies()).map(|(which, body)| [vec![which, 1], body].concat()).collect(),
        _ => bodies().collect(),
    }
}

fn damage(input: &mut Vec<u8>, random: &mut Pcg64Mcg) {
    for _ in 0..random.random_range(1..4) {
        let at = random.random_range(0..=input.len());
        match random.random_range(0..6) {
            0 => input.truncate(at),
            1 => input.insert(at, random.random()),
            2 if at < input.len() => input[at] ^= 1 << random.random_range(0..8),
            // A length or a sequence number far from any that makes sense.
            3 if at + 4 <= input.len() => input[at..at + 4].fill(if random.random() { 0xff } else { 0x7f }),
            4 => input.extend_from_within(at..),
            _ => input.splice(at..at, random.random::<[u8; 8]>()).for_each(drop),
        }
        input.truncate(1 << 16);
    }
}

#[test]
fn no_decoder_panics_or_hangs_whatever_comes() {
    let told = |variable: &str| std::env::var(variable).ok().map(|number| number.parse::<u64>().unwrap());
    let (inputs, seed) = (told("FUZZ_INPUTS").unwrap_or(INPUTS), told("FUZZ_SEED").unwrap_or(1));
    for (name, target) in TARGETS {
        let mut random = Pcg64Mcg::seed_from_u64(seed);
        let seeds = seeds(name);
        seeds.iter().for_each(|seed| target(seed));
        for _ in 0..inputs {
            let mut input = seeds[random.random_range(0..seeds.len())].clone();
            damage(&mut input, &mut random);
            target(&input);
        }
    }
}
