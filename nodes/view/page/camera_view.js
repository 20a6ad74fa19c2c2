// The camera's picture with what the selector makes of it.

import { byId, setText } from "./dom.js";
import { clock } from "./format.js";
import { verdict, VERDICTS } from "./match.js";
import { colour } from "./theme.js";

export class CameraView {
  constructor() {
    this.canvas = byId("camera-picture");
    this.note = byId("camera-note");
    /** @type {{bitmap: ImageBitmap, header: any} | null} */
    this.picture = null;
    this.isDecoding = false;
    this.waiting = null;
    this.candidates = null;
  }

  clear() {
    this.picture?.bitmap.close();
    this.picture = null;
    this.canvas.getContext("2d").clearRect(0, 0, this.canvas.width, this.canvas.height);
    setText(this.note, "No picture yet");
  }

  /** Takes a picture in; of those that come while one is unpacked, the newest alone. */
  async show(header, bytes) {
    if (this.isDecoding) {
      this.waiting = [header, bytes];
      return;
    }
    this.isDecoding = true;
    try {
      const bitmap = await createImageBitmap(new Blob([bytes], { type: `image/${header.format}` }));
      this.picture?.bitmap.close();
      this.picture = { bitmap, header };
      this.draw();
    } catch {
      setText(this.note, "A picture came that cannot be shown");
    } finally {
      this.isDecoding = false;
    }
    if (this.waiting) {
      const next = this.waiting;
      this.waiting = null;
      this.show(...next);
    }
  }

  /** Draws the newest picture with the marks that belong to it. */
  draw() {
    if (!this.picture) {
      return;
    }
    const { bitmap, header } = this.picture;
    const { canvas } = this;
    if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
      [canvas.width, canvas.height] = [bitmap.width, bitmap.height];
    }
    const context = canvas.getContext("2d");
    context.drawImage(bitmap, 0, 0);
    const counts = { pick: 0, seen: 0, unsure: 0 };
    for (const mark of header.marks ?? []) {
      const kind = verdict(mark);
      counts[kind] += 1;
      drawMark(context, mark, kind);
    }
    const total = counts.pick + counts.seen + counts.unsure;
    setText(this.note, `${clock(header.stamp_s)} · ${total} seen, ${counts.pick} may be picked`);
  }
}

function drawMark(context, { u_px: u, v_px: v, radius_px: size }, kind) {
  const radius = size * 1.25;
  const { look, colour: name } = VERDICTS[kind];
  context.setLineDash(look === 2 ? [4, 3] : []);
  context.beginPath();
  if (look === 3) {
    context.moveTo(u, v - radius * 1.2);
    for (const [x, y] of [[1.2, 0], [0, 1.2], [-1.2, 0], [0, -1.2]]) {
      context.lineTo(u + x * radius, v + y * radius);
    }
  } else {
    context.arc(u, v, radius, 0, 7);
  }
  // A dark line below makes the colour readable on any ground.
  for (const [style, width] of [["#0008", 4], [colour(name), 2]]) {
    context.strokeStyle = style;
    context.lineWidth = width;
    context.stroke();
  }
  context.setLineDash([]);
}
