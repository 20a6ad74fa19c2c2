// Which part is which: what the selector sees, laid over the parts that are truly there.

/** Farthest that a part may be from where the selector saw it, in radii of the part. */
const NEAR = 1.5;

/**
 * The selector's candidates of a picture, each with the true part that it means, if one is there. Both are compared at the
 * time of the picture.
 * @param {any} candidates of a frame @param {any} truth nearest in time to the picture
 * @returns {{byPart: Map<number, {candidate: any, off: [number, number]}>, unmatched: any[]}} `off` is how far from the
 *   truth the selector saw it, m
 */
export function matched(candidates, truth) {
  const byPart = new Map();
  const unmatched = [];
  const pairs = [];
  for (const candidate of candidates?.parts ?? []) {
    let isNear = false;
    truth?.id.forEach((id, index) => {
      const off = [candidate.x_m - truth.position_m[index * 3], candidate.y_m - truth.position_m[index * 3 + 1]];
      const distance = Math.hypot(off[0], off[1]);
      if (distance < NEAR * candidate.radius_m) {
        pairs.push({ candidate, id, off, distance });
        isNear = true;
      }
    });
    if (!isNear) {
      unmatched.push(candidate);
    }
  }
  pairs.sort((a, b) => a.distance - b.distance);
  const taken = new Set();
  for (const { candidate, id, off } of pairs) {
    if (!byPart.has(id) && !taken.has(candidate)) {
      byPart.set(id, { candidate, off });
      taken.add(candidate);
    }
  }
  const left = new Set(pairs.map(({ candidate }) => candidate).filter((candidate) => !taken.has(candidate)));
  return { byPart, unmatched: [...unmatched, ...left] };
}

/** What the selector says of a part: its colour in the style sheet, its mark's look, and the words for it. */
export const VERDICTS = {
  pick: { colour: "pick", look: 1, words: "may be picked" },
  seen: { colour: "seen", look: 2, words: "seen, may not be picked" },
  unsure: { colour: "unsure", look: 3, words: "pose not known" },
  unseen: { colour: "unseen", look: null, words: "not seen by the selector" },
};

/** @param {any} candidate or nothing @returns {keyof typeof VERDICTS} */
export function verdict(candidate) {
  if (!candidate) {
    return "unseen";
  }
  if (candidate.may_be_picked) {
    return "pick";
  }
  return candidate.pose_class ? "seen" : "unsure";
}

/** Why a part may not be picked, for people. */
export const REFUSALS = {
  pose_unsure: "its pose is not sure yet",
  pose_disagrees: "the latest picture shows another pose",
  off_plateau: "it does not lie wholly on the plateau",
  part_too_near: "the gripper has no room towards another part",
  wall_too_near: "the gripper has no room towards a wall",
};
