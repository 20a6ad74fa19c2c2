// What one period of the tray's motion does to a part: where it sticks and where it slips.
//
// A point mass under Coulomb friction, as in the paper (Eqs 11 to 17): N = g cos φ − a sin φ, and w, its speed relative to
// the tray along the track, changes by −g sin φ − a cos φ less friction. The part sticks while friction can hold it.

const G_M_S2 = 9.81;
/** Periods after which a part has come to its steady motion, or drifts for good. */
const PERIODS = 120;

/** What a part does at an instant. */
export const STICKS = 0;
export const SLIPS_ON = 1;
export const SLIPS_BACK = 2;

/**
 * The steady motion of a part.
 * @param {ArrayLike<number>} acceleration of the tray along the track over one period, evenly sampled, m/s²
 * @param {number} step between samples, s
 * @param {{friction_static: number, friction_kinetic: number}} friction
 * @param {number} slope of the track, rad
 * @returns {{phases: Uint8Array, slip: Float64Array, mean: number}} what it does and w in m/s at each sample, and the
 *   mean of w over the period, m/s
 */
export function partOver(acceleration, step, friction, slope) {
  const count = acceleration.length;
  const phases = new Uint8Array(count);
  const slip = new Float64Array(count);
  const [sin, cos] = [Math.sin(slope), Math.cos(slope)];
  let w = 0;
  let mean = 0;
  for (let period = 0; period < PERIODS; period += 1) {
    const before = w;
    let sum = 0;
    for (let i = 0; i < count; i += 1) {
      const a = acceleration[i];
      const normal = Math.max(0, G_M_S2 * cos - a * sin);
      const drive = -G_M_S2 * sin - a * cos;
      slip[i] = w;
      phases[i] = phaseOf(w, drive, friction.friction_static * normal);
      const next = stepped(w, drive, friction, normal, step);
      sum += (w + next) / 2;
      w = next;
    }
    mean = sum / count;
    if (Math.abs(w - before) < 1e-7) {
      break;
    }
  }
  return { phases, slip, mean };
}

function phaseOf(w, drive, hold) {
  if (w === 0 && Math.abs(drive) <= hold) {
    return STICKS;
  }
  return w > 0 || (w === 0 && drive > 0) ? SLIPS_ON : SLIPS_BACK;
}

function stepped(w, drive, { friction_static: holding, friction_kinetic: sliding }, normal, step) {
  if (w === 0) {
    return Math.abs(drive) <= holding * normal ? 0 : step * (drive - Math.sign(drive) * sliding * normal);
  }
  const next = w + step * (drive - Math.sign(w) * sliding * normal);
  // It comes to rest where it would turn round; the next step tells whether it stays.
  return next * w <= 0 ? 0 : next;
}

/**
 * Stretches of the same phase, but for sticking.
 * @param {Uint8Array} phases @param {number} step s
 * @returns {{from: number, to: number, phase: number}[]} s
 */
export function stretches(phases, step) {
  const found = [];
  phases.forEach((phase, index) => {
    const last = found.at(-1);
    if (phase === STICKS) {
      return;
    }
    if (last && last.phase === phase && last.to === index) {
      last.to = index + 1;
    } else {
      found.push({ from: index, to: index + 1, phase });
    }
  });
  return found.map(({ from, to, phase }) => ({ from: from * step, to: to * step, phase }));
}
