#!/usr/bin/env python3
"""Time of the selector and of the same pipeline in OpenCV on the same frames, in the same run.

The frames and the taught model come from `feeder-lab score-vision --save`, which also times the selector. OpenCV gets the steps
that the selector takes, each with the function made for it: 3x3 binomial filter (sepFilter2D), light of the plateau by
robust least squares (numpy), foreground (threshold, connectedComponentsWithStats), mean brightness of rings about every
pixel (filter2D) and their minima (erode), the best of K turned templates round each minimum (matchTemplate), place and yaw to
a fraction of a pixel by Gauss-Newton (remap), and the parts in the order of their match (fillConvexPoly). What does not change
from frame to frame, the plateau's mask and the turned templates, it is given; it is spared the selector's glance at all yaws
wherever the rings allow a part. One thread each.

    python3 -m venv VENV && VENV/bin/pip install -r tests/opencv/requirements.txt
    cargo build --release && VENV/bin/python tests/opencv/compare.py

Prints a table: milliseconds of computing time per 640x480 frame.
"""

import argparse
import json
import pathlib
import subprocess
import tempfile
import time

import cv2
import numpy as np

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
STRIDE = 2
RING_MISS_MAX = 6.0
TURN_STEP_PX = 1.4
STEPS_MAX = 12
COARSE_MISS_MAX = 0.02
FIT_MISS_MAX = 0.01


def plane(rows):
    """A picture of the model: two hexadecimal digits per entry, hundredths above -128."""
    return (np.array([list(bytes.fromhex(row)) for row in rows], np.float32) - 128.0) / 100.0


class Pose:
    """A taught pose, ready to be looked for at a pixel per texel."""

    def __init__(self, taught):
        self.at_yaws = [plane(rows) for rows in taught["at_yaws"]]
        self.mean = sum(self.at_yaws) / len(self.at_yaws)
        self.side = len(self.mean)
        self.texel_m = taught["texel_m"]
        self.symmetry = taught["yaw_symmetry"]
        self.outline_px = np.array(taught["outline_m"], np.float32) / self.texel_m
        self.radius_px = float(np.linalg.norm(self.outline_px, axis=1).max())
        middle = self.side // 2
        inside = np.zeros_like(self.mean, np.uint8)
        cv2.fillConvexPoly(inside, np.rint(self.outline_px + middle).astype(np.int32), 1)
        self.mask = cv2.dilate(inside, np.ones((3, 3), np.uint8)).astype(np.float32)
        rows, columns = np.nonzero(self.mask)
        self.x = (columns - middle).astype(np.float32)
        self.y = (rows - middle).astype(np.float32)
        self.index = (rows, columns)
        radii = np.hypot(*np.meshgrid(*[np.arange(self.side) - middle] * 2))
        count = int(self.radius_px) + 1
        self.rings = [(np.rint(radii) == ring).astype(np.float32) for ring in range(count)]
        self.rings = [ring / ring.sum() for ring in self.rings]
        self.ring_means = [float((ring * self.mean).sum()) for ring in self.rings]
        if self.symmetry == 0:
            self.yaws = [0.0]
        else:
            span = 2.0 * np.pi / self.symmetry
            turns = max(2, int(np.ceil(span * self.radius_px / TURN_STEP_PX)))
            self.yaws = [span * turn / turns for turn in range(turns)]
        self.turned = [self.turn(yaw) for yaw in self.yaws]

    def picture(self, yaw):
        """The picture expected at a yaw, seen from straight above."""
        steps = len(self.at_yaws) - 1
        if steps == 0:
            return self.at_yaws[0]
        period = 2.0 * np.pi / self.symmetry
        place = (yaw % period) / period * steps
        first = min(int(place), steps - 1)
        return self.at_yaws[first] + (place - first) * (self.at_yaws[first + 1] - self.at_yaws[first])

    def turn(self, yaw):
        """Template and mask as the image shows them: its rows run downwards."""
        middle = self.side // 2
        cos, sin = np.cos(yaw), np.sin(yaw)
        # Image (x right, y down) to texels (x right, y up), turned back by the yaw.
        into = np.array([[cos, -sin], [-sin, -cos]])
        matrix = np.hstack([into, (middle - into @ [middle, middle])[:, None]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        warp = lambda picture: cv2.warpAffine(picture.astype(np.float32), matrix, (self.side, self.side), flags=flags)
        return warp(self.picture(yaw)), (warp(self.mask) > 0.5).astype(np.float32)


class Pipeline:
    """The selector's steps in OpenCV."""

    def __init__(self, model, shape, bare):
        self.poses = [Pose(pose) for pose in model["poses"]]
        height, width = shape
        v, u = np.meshgrid(*[np.linspace(-1, 1, size, endpoint=False) for size in shape], indexing="ij")
        self.basis = np.stack([np.ones(shape), u, v, u * u, u * v, v * v], -1).astype(np.float32)
        self.light = np.array(model["plateau_light"], np.float32)
        # Plateau: what in a frame without parts is as bright as the plateau was taught to be.
        expected = self.basis @ self.light
        near = (np.abs(cv2.blur(bare, (5, 5)).astype(np.float32) / expected - 1.0) < 0.12).astype(np.uint8)
        near[: height // 3] = 0
        count, labels, stats, _ = cv2.connectedComponentsWithStats(near)
        largest = 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])) if count > 1 else 0
        self.plateau = cv2.morphologyEx((labels == largest).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((41, 41)))
        self.samples = np.zeros(shape, bool)
        self.samples[::4, ::4] = True
        self.samples &= self.plateau > 0

    def relative(self, image):
        """Brightness above the plateau's, relative to it."""
        kernel = np.array([0.25, 0.5, 0.25], np.float32)
        smooth = cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel)
        basis, level = self.basis[self.samples], smooth[self.samples]
        light = self.light.copy()
        for limit in (10.0, 8.0):
            miss = level - basis @ light
            weight = np.clip(1.0 - (miss / limit) ** 2, 0.0, None)[:, None]
            normal = (basis * weight).T @ basis + 0.5 * len(level) * np.eye(6, dtype=np.float32)
            light += np.linalg.solve(normal, (basis * weight).T @ miss)
        expected = self.basis @ light
        return (smooth - expected) / expected * self.plateau, np.abs(smooth - expected) * self.plateau

    def seeds(self, relative, difference):
        """Places where rings of brightness are those of a pose."""
        _, foreground = cv2.threshold(difference, 10.0, 1.0, cv2.THRESH_BINARY)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(foreground.astype(np.uint8))
        keep = stats[:, cv2.CC_STAT_AREA] >= 9
        keep[0] = False
        near = cv2.dilate(keep[labels].astype(np.uint8), np.ones((5, 5), np.uint8))[::STRIDE, ::STRIDE] > 0
        for pose in self.poses:
            miss = np.zeros(near.shape, np.float32)
            for ring, mean in zip(pose.rings, pose.ring_means):
                seen = cv2.filter2D(relative, cv2.CV_32F, ring)[::STRIDE, ::STRIDE]
                miss += np.minimum(((seen - mean) / 0.1) ** 2, 9.0)
            miss /= len(pose.rings)
            lowest = (miss <= cv2.erode(miss, np.ones((3, 3), np.uint8))) & (miss < RING_MISS_MAX) & near
            for row, column in zip(*np.nonzero(lowest)):
                yield pose, column * STRIDE, row * STRIDE

    def coarse(self, relative, pose, column, row):
        """The turned template that misses least within a pixel, and by how much."""
        reach = pose.side // 2 + 1
        patch = relative[row - reach : row + reach + 1, column - reach : column + reach + 1]
        if patch.shape != (2 * reach + 1, 2 * reach + 1):
            return None
        best = None
        for yaw, (template, mask) in zip(pose.yaws, pose.turned):
            miss = cv2.matchTemplate(patch, template, cv2.TM_SQDIFF, mask=mask)
            least, _, (x, y), _ = cv2.minMaxLoc(miss)
            least /= mask.sum()
            if best is None or least < best[0]:
                best = (least, yaw, column + x - 1, row + y - 1)
        return best if best[0] < COARSE_MISS_MAX else None

    def refine(self, relative, pose, yaw, x, y):
        """Place and yaw by Gauss-Newton; the template's gradient is taken at the guess."""
        if pose.symmetry:
            yaw %= 2.0 * np.pi / pose.symmetry
        picture = pose.picture(yaw)
        along_x = cv2.Sobel(picture, cv2.CV_32F, 1, 0, ksize=1) * 0.5
        along_y = cv2.Sobel(picture, cv2.CV_32F, 0, 1, ksize=1) * 0.5
        gx, gy = along_x[pose.index], along_y[pose.index]
        slopes = np.stack([gx, gy, gy * pose.x - gx * pose.y], -1)
        normal = slopes.T @ slopes + 1e-6 * np.eye(3)
        value = picture[pose.index]
        miss = np.inf
        for _ in range(STEPS_MAX):
            cos, sin = np.cos(yaw), np.sin(yaw)
            at_x = (x + cos * pose.x - sin * pose.y).astype(np.float32)
            at_y = (y - sin * pose.x - cos * pose.y).astype(np.float32)
            seen = cv2.remap(relative, at_x[None], at_y[None], cv2.INTER_LINEAR)[0]
            difference = np.clip(seen - value, -0.3, 0.3)
            miss = float(difference @ difference) / len(value)
            change = np.linalg.solve(normal, slopes.T @ difference)
            if pose.symmetry == 0:
                change[2] = 0.0
            x -= cos * change[0] - sin * change[1]
            y -= -sin * change[0] - cos * change[1]
            yaw -= change[2]
            if np.hypot(change[0], change[1]) + abs(change[2]) * pose.radius_px < 0.03:
                break
        return miss, yaw, x, y

    def parts(self, image):
        """Parts a frame shows: pose, yaw and place."""
        relative, difference = self.relative(image)
        fits = []
        for pose, column, row in self.seeds(relative, difference):
            guess = self.coarse(relative, pose, column, row)
            if guess:
                miss, yaw, x, y = self.refine(relative, pose, *guess[1:])
                if miss < FIT_MISS_MAX:
                    fits.append((miss, pose, yaw, x, y))
        fits.sort(key=lambda fit: fit[0])
        shown = np.zeros(image.shape, np.uint8)
        found = []
        for miss, pose, yaw, x, y in fits:
            turn = np.array([[np.cos(yaw), -np.sin(yaw)], [-np.sin(yaw), -np.cos(yaw)]])
            corners = np.rint(pose.outline_px @ turn.T + [x, y]).astype(np.int32)
            left, top, width, height = cv2.boundingRect(corners)
            left, top = max(left, 0), max(top, 0)
            window = shown[top : top + height, left : left + width]
            body = np.zeros_like(window)
            cv2.fillConvexPoly(body, corners - [left, top], 1)
            if (window * body).sum() <= 0.2 * body.sum():
                window |= body
                found.append((pose, yaw, x, y))
        return found


def timed(pipeline, image, repeats):
    """Least computing time over repeats, ms, and the parts found."""
    best = np.inf
    for _ in range(repeats):
        begin = time.thread_time()
        found = pipeline.parts(image)
        best = min(best, time.thread_time() - begin)
    return 1e3 * best, len(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", default=["grommet", "hex_nut", "bracket"])
    parser.add_argument("--lab", default=REPOSITORY / "target/release/feeder-lab", help="the feeder-lab command")
    parser.add_argument("--frames", type=int, default=60, help="frames that the selector is timed over")
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"OpenCV {cv2.__version__}\n{'part':9} {'cover':>5} {'sigma':>5} {'selector ms':>11} {'OpenCV ms':>9} {'found':>11}")
    for part in options.parts:
        with tempfile.TemporaryDirectory() as folder:
            command = [options.lab, "score-vision", part, "--frames", str(options.frames), "--save", folder]
            table = subprocess.run(command, check=True, capture_output=True, text=True).stdout
            folder = pathlib.Path(folder)
            model = json.loads((folder / f"{part}.model.json").read_text())
            bare = cv2.imread(str(folder / f"{part}_bare.png"), cv2.IMREAD_GRAYSCALE)
            pipeline = Pipeline(model, bare.shape, bare)
            rows = [line.split() for line in table.splitlines() if line.startswith(part)]
            kinds = [(fraction, sigma) for fraction in ("0.1", "0.5") for sigma in ("2", "6", "12")]
            for (fraction, sigma), row in zip(kinds, rows):
                image = cv2.imread(str(folder / f"{part}_{fraction}_{sigma}.png"), cv2.IMREAD_GRAYSCALE)
                spent_ms, count = timed(pipeline, image, options.repeats)
                seen = float(row[4]) * float(row[5]) / 100
                print(f"{part:9} {row[1]:>5} {sigma:>5} {row[-1]:>11} {spent_ms:9.2f} {seen:5.0f}/{count:5d}")


if __name__ == "__main__":
    main()
