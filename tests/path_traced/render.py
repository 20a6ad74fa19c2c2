#!/usr/bin/env python3
"""Pictures of a scenario's tray with parts on its plateau, path-traced by Mitsuba, with their truth.

What the selector learns first it learns from our own renderer's pictures, so these judge it by another's: light that parts, tray and
floor throw at each other, soft shadows, a lens with an aperture, gloss. Lights: `like` (as the scenario's own lamp), `dome` (soft sky),
`ring` (a ring light round the lens), `side` (one lamp, low). Layouts: `teach` (nine parts apart, to learn from) and `check_all` (some 25
parts apart and touching, in all poses, with screws, hairs, chips and blanks of the part's outline). Surfaces: `matt` and `gloss`. With
`--lamps` the low lamp stands elsewhere: one picture of the second kind for each place, `side1` and so on; other places need another folder.
With `--few` six blanks and a screw lie among five parts (`check_few`), one picture for each light and surface.

    python3 -m venv VENV && VENV/bin/pip install -r tests/path_traced/requirements.txt
    cargo build --release --package feeder_lab
    VENV/bin/python tests/path_traced/render.py --out FOLDER cap bracket
    target/release/feeder-lab score-pictures FOLDER cap bracket --light rendered --light dome --light ring --verbose

Takes some ten seconds a picture on two cores, and leaves out pictures that FOLDER holds already. What lies where follows from the
picture's name; where nothing else does, numbers of lights, gloss and noise are assumed.
"""

import argparse
import hashlib
import json
import math
import pathlib
import subprocess
import sys

import mitsuba as mi
import numpy as np
from PIL import Image
from shapely import affinity
from shapely.geometry import MultiPoint, Point, Polygon

mi.set_variant("scalar_rgb")

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
LAB = REPOSITORY / "target/release/feeder-lab"
# Room that the gripper needs, m, and grey level that the plateau is exposed to.
CLEARANCE_M = 0.001_25
PLATEAU_GREY = 164
# Elevation and azimuth.
LOW_LAMP_RAD = (math.radians(37), -0.85)
PLAN = [
    ("teach", "dome", "matt", 6),
    ("teach", "ring", "matt", 6),
    ("check_all", "like", "matt", 2),
    ("check_all", "dome", "matt", 2),
    ("check_all", "ring", "matt", 2),
    ("check_all", "side", "matt", 2),
    ("check_all", "dome", "gloss", 1),
    ("check_all", "ring", "gloss", 1),
]
FEW = [("check_few", light, kind, 1) for layout, light, kind, _ in PLAN if layout == "check_all"]
# How many parts lie apart, by what gap, how many lie against another one, and what else lies there.
LAYOUTS = {
    "teach": (9, 0.010, 0, []),
    "check_all": (20, 0.0022, 8, ["screw", "hair", "chip", "lookalike", "lookalike"] * 2),
    "check_few": (4, 0.006, 1, ["lookalike"] * 6 + ["screw"]),
}


def mesh(vertices, faces, **properties):
    """Triangles with a bsdf or an emitter."""
    props = mi.Properties()
    for name, value in properties.items():
        props[name] = value
    shape = mi.Mesh("mesh", len(vertices), len(faces), props=props)
    buffers = mi.traverse(shape)
    buffers["vertex_positions"] = np.asarray(vertices, dtype=np.float32).ravel()
    buffers["faces"] = np.asarray(faces, dtype=np.uint32).ravel()
    buffers.update()
    return shape


def grey(value):
    return {"type": "rgb", "value": [float(value)] * 3}


def surface(reflectance, kind="matt"):
    """A surface that sends back this share of the light."""
    matt = {"type": "diffuse", "reflectance": grey(reflectance)}
    gloss = {"type": "roughplastic", "diffuse_reflectance": grey(reflectance), "alpha": 0.2}
    return mi.load_dict({"type": "twosided", "bsdf": gloss if kind == "gloss" else matt})


def band(lower, upper):
    """Faces between two rows of as many points each."""
    count = len(lower)
    steps = range(count - 1)
    return lower + upper, [face for i in steps for face in ([i, i + 1, count + i + 1], [i, count + i + 1, count + i])]


def require(is_drawn, what):
    if not is_drawn:
        sys.exit(f"the scenario has {what}: that is not drawn")


class Setting:
    """The scenario without parts: camera, tray and lights, on the platen."""

    def __init__(self, scene, lamps):
        self.scene, self.lamps = scene, lamps
        tray, geometry = scene["tray"], scene["tray"]["geometry"]
        self.x_m, self.y_m, yaw_rad = scene["feeding_place"]
        require(yaw_rad == 0.0, "a tray that is turned at the feeding place")
        self.inner_m, self.outer_m = geometry["inner_radius_m"], geometry["outer_radius_m"]
        self.foot_m = tray["floor_height_m"]
        self.plateau_m = self.foot_m + geometry["rise_m"]
        self.wall_top_m = self.plateau_m + tray["lip_m"]
        self.wall_m = tray["wall_thickness_m"]
        ramp_rad = geometry["ramp_angle_rad"]
        require(abs(ramp_rad - math.pi) < 1e-9, "a plateau that is not half a ring")
        camera = scene["camera"]
        self.width_px, self.height_px = camera["width_px"], camera["height_px"]
        self.eye_m = [camera["pose"][key] for key in ("x_m", "y_m", "height_m")]
        self.focal_px = camera["focal_length_px"]
        require(camera["pose"]["yaw_rad"] == 0.0, "a camera that is turned")
        require(not any(camera["distortion"].values()), "a lens that distorts")
        middle_px = [0.5 * (self.width_px - 1), 0.5 * (self.height_px - 1)]
        require(camera["principal_point_px"] == middle_px, "a principal point beside the picture's middle")

    def at(self, radius_m, angle_rad, height_m):
        return [self.x_m + radius_m * math.cos(angle_rad), self.y_m + radius_m * math.sin(angle_rad), height_m]

    def tray(self):
        """Platen and tray."""
        looks = self.scene["tray_appearance"]
        track, wall, rim = (surface(looks[key + "_reflectance"]) for key in ("surface", "wall", "rim"))
        platen = surface(0.5 * (looks["platen_reflectance"] + looks["tooth_reflectance"]))
        half, whole = np.linspace(0, math.pi, 181), np.linspace(0, 2 * math.pi, 361)
        rise_m = self.plateau_m - self.foot_m

        def ring(angles, inner, outer, look):
            """Between two edges, each a radius and a height, or a height for each angle."""
            edges = (
                [self.at(radius_m, angle, height_m) for angle, height_m in zip(angles, np.broadcast_to(heights_m, len(angles)))]
                for radius_m, heights_m in (inner, outer)
            )
            return mesh(*band(*edges), bsdf=look)

        ramp_m = self.foot_m + rise_m * half / math.pi
        inner_m, outer_m, top_m = self.inner_m, self.outer_m, self.wall_top_m
        drop_off = band(
            [self.at(radius_m, 0, self.foot_m) for radius_m in (inner_m, outer_m)],
            [self.at(radius_m, 0, self.plateau_m) for radius_m in (inner_m, outer_m)],
        )
        return [
            mesh([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2], [0, 2, 3]], bsdf=platen),
            ring(half, (inner_m, ramp_m), (outer_m, ramp_m), track),
            ring(math.pi + half, (inner_m, self.plateau_m), (outer_m, self.plateau_m), track),
            mesh(*drop_off, bsdf=wall),
            ring(whole, (outer_m, self.foot_m), (outer_m, top_m), wall),
            ring(whole, (outer_m, top_m), (outer_m + self.wall_m, top_m), rim),
            ring(whole, (outer_m + self.wall_m, 0.0), (outer_m + self.wall_m, top_m), wall),
            ring(whole, (inner_m, self.foot_m), (inner_m, top_m), wall),
            ring(whole, (0.0, top_m), (inner_m, top_m), rim),
        ]

    def lights(self, name):
        """Groups of emitters that are rendered apart and added: less noise. A level surface gets 1 of them together."""
        light = self.scene["light"]
        if name == "dome":
            return [[self.sky(1.0)]]
        if name == "ring":
            return [[self.sky(0.1)], [self.ring_light(0.9)]]
        if name == "like":
            share = light["diffuse_ratio"]
            return [[self.sky(share)], [self.lamp(1 - share, light["elevation_rad"], light["azimuth_rad"])]]
        return [[self.sky(0.5)], [self.lamp(0.5, *self.lamps.get(name, LOW_LAMP_RAD))]]

    @staticmethod
    def sky(share):
        return mi.load_dict({"type": "constant", "radiance": grey(share / math.pi)})

    def lamp(self, share, elevation_rad, azimuth_rad, distance_m=0.6, radius_m=0.03):
        level = math.cos(elevation_rad)
        towards = np.array([level * math.cos(azimuth_rad), level * math.sin(azimuth_rad), math.sin(elevation_rad)])
        middle = np.array([self.eye_m[0], self.eye_m[1], self.plateau_m])
        radiance = share * distance_m**2 / (math.pi * radius_m**2 * math.sin(elevation_rad))
        frame = mi.ScalarTransform4f().look_at((middle + distance_m * towards).tolist(), middle.tolist(), [0, 0, 1])
        emitter = {"type": "area", "radiance": grey(radiance)}
        return mi.load_dict({"type": "disk", "to_world": frame.scale([radius_m, radius_m, 1]), "emitter": emitter})

    def ring_light(self, share, inner_m=0.045, outer_m=0.07):
        x_m, y_m, height_m = self.eye_m
        angles = np.linspace(0, 2 * math.pi, 61)
        edges = ([[x_m + r * math.cos(a), y_m + r * math.sin(a), height_m] for a in angles] for r in (inner_m, outer_m))
        radiance = share * (height_m - self.plateau_m) ** 2 / (math.pi * (outer_m**2 - inner_m**2))
        emitter = mi.load_dict({"type": "area", "radiance": grey(radiance)})
        return mesh(*band(*edges), bsdf=surface(0.0), emitter=emitter)

    def sensor(self, samples):
        x_m, y_m, height_m = self.eye_m
        return {
            "type": "thinlens",
            "fov": 2 * math.degrees(math.atan(0.5 * self.width_px / self.focal_px)),
            "fov_axis": "x",
            "aperture_radius": 0.003,
            "focus_distance": height_m - self.plateau_m,
            "to_world": mi.ScalarTransform4f().look_at([x_m, y_m, height_m], [x_m, y_m, 0], [0, 1, 0]),
            "film": {
                "type": "hdrfilm",
                "width": self.width_px,
                "height": self.height_px,
                "pixel_format": "luminance",
                "rfilter": {"type": "gaussian", "stddev": 0.5},
            },
            "sampler": {"type": "independent", "sample_count": samples},
        }

    def plateau(self):
        """Which pixels show the plateau, clear of its edges."""
        rows, columns = np.mgrid[0 : self.height_px, 0 : self.width_px]
        m_per_px = (self.eye_m[2] - self.plateau_m) / self.focal_px
        x = (columns - 0.5 * (self.width_px - 1)) * m_per_px + self.eye_m[0] - self.x_m
        y = -(rows - 0.5 * (self.height_px - 1)) * m_per_px + self.eye_m[1] - self.y_m
        radius_m = np.hypot(x, y)
        return (radius_m > self.inner_m + 0.005) & (radius_m < self.outer_m - 0.005) & (y < -0.003)

    def gaps_m(self, outline):
        """How far an outline in the tray frame is from the nearer wall, and from the plateau's straight edges."""
        corners = np.array(outline.exterior.coords)
        outer_m = self.outer_m - np.hypot(corners[:, 0], corners[:, 1]).max()
        return min(outer_m, Point(0, 0).distance(outline) - self.inner_m), -corners[:, 1].max()


def turned(vertices, x_m, y_m, yaw_rad):
    vertices = np.asarray(vertices)
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    x, y = vertices[:, 0], vertices[:, 1]
    return np.stack([cos * x - sin * y + x_m, sin * x + cos * y + y_m, vertices[:, 2]], 1)


def cylinder(radius_m, height_m, corners=48):
    angles = np.linspace(0, 2 * math.pi, corners, endpoint=False)
    circles = [[radius_m * math.cos(a), radius_m * math.sin(a), z] for z in (0, height_m) for a in angles]
    vertices = circles + [[0, 0, height_m]]
    following = [(i, (i + 1) % corners) for i in range(corners)]
    sides = [face for i, j in following for face in ([i, j, corners + j], [i, corners + j, corners + i])]
    return vertices, sides + [[2 * corners, corners + i, corners + j] for i, j in following]


def foreign_thing(kind, shape, random):
    """Vertices, faces and reflectance of something that is no part."""
    if kind == "screw":
        shank, head = cylinder(0.0012, 0.007), cylinder(0.0022, 0.0016)
        lying = [[z - 0.0035, y, x + 0.0022] for x, y, z in shank[0]] + [[z + 0.0035, y, x + 0.0022] for x, y, z in head[0]]
        return lying, shank[1] + [[corner + len(shank[0]) for corner in face] for face in head[1]], 0.4
    if kind == "hair":
        bends = np.cumsum(random.normal(0, 0.25, 30))
        along = np.cumsum(0.0005 * np.stack([np.cos(bends), np.sin(bends)], 1), 0)
        edges = ([[x, y + side, 0.0002] for x, y in along] for side in (-0.00006, 0.00006))
        return *band(*edges), 0.05
    if kind == "chip":
        angles = np.sort(random.uniform(0, 2 * math.pi, 5))
        return [[0.0018 * math.cos(a), 0.0018 * math.sin(a), 0.0005] for a in angles], [[0, 1, 2], [0, 2, 3], [0, 3, 4]], 0.5
    # A blank: as the part from above, and as bright, half as high and without features.
    pose = shape["poses"][next(i for i, pose in enumerate(shape["poses"]) if pose["is_wanted"])]
    outline, count = pose["outline_m"], len(pose["outline_m"])
    height_m = 0.5 * max(z for _, _, z in pose["vertices_m"])
    vertices = [[x, y, z] for z in (0, height_m) for x, y in outline]
    following = [(i, (i + 1) % count) for i in range(count)]
    sides = [face for i, j in following for face in ([i, j, count + j], [i, count + j, count + i])]
    top = [[count, count + i, count + i + 1] for i in range(1, count - 1)]
    return vertices, sides + top, float(np.median(shape["reflectance"]))


class Layout:
    """Parts and other things on the plateau."""

    def __init__(self, setting, shape, random):
        self.setting, self.shape, self.random = setting, shape, random
        self.parts, self.foreign, self.outlines = [], [], []

    def pose(self):
        """Every other part is in a pose that is wanted, whatever comes of pouring."""
        poses = self.shape["poses"]
        if self.random.random() < 0.5:
            return int(self.random.choice([i for i, pose in enumerate(poses) if pose["is_wanted"]]))
        poured = np.array([pose["poured"] for pose in poses])
        return int(self.random.choice(len(poses), p=poured / poured.sum()))

    def is_free(self, outline, gap_m, edge_m):
        to_wall_m, to_edge_m = self.setting.gaps_m(outline)
        clear = min(to_wall_m, to_edge_m) > edge_m
        return clear and all(outline.distance(other) > gap_m for other in self.outlines)

    def free_place(self, outline, gap_m, tries=400):
        for _ in range(tries):
            radius_m = math.sqrt(self.random.uniform(self.setting.inner_m**2, self.setting.outer_m**2))
            angle_rad = self.random.uniform(math.pi, 2 * math.pi)
            place = (radius_m * math.cos(angle_rad), radius_m * math.sin(angle_rad))
            if self.is_free(affinity.translate(outline, *place), gap_m, 0.0012):
                return place
        return None

    def outline(self, pose, yaw_rad):
        outline = Polygon(self.shape["poses"][pose]["outline_m"])
        return affinity.rotate(outline, yaw_rad, origin=(0, 0), use_radians=True)

    def add(self, pose, yaw_rad, place):
        self.parts.append({"pose": pose, "x_m": place[0], "y_m": place[1], "yaw_rad": yaw_rad})
        self.outlines.append(affinity.translate(self.outline(pose, yaw_rad), *place))

    def lay_apart(self, gap_m):
        pose, yaw_rad = self.pose(), self.random.uniform(0, 2 * math.pi)
        place = self.free_place(self.outline(pose, yaw_rad), gap_m)
        if place:
            self.add(pose, yaw_rad, place)

    def lay_against_another(self):
        other = int(self.random.integers(len(self.parts)))
        pose, yaw_rad, towards = self.pose(), self.random.uniform(0, 2 * math.pi), self.random.uniform(0, 2 * math.pi)
        outline, start = self.outline(pose, yaw_rad), self.parts[other]
        for distance_m in np.arange(0.001, 0.02, 0.0001):
            place = (start["x_m"] + distance_m * math.cos(towards), start["y_m"] + distance_m * math.sin(towards))
            if affinity.translate(outline, *place).distance(self.outlines[other]) > 0.00005:
                if self.is_free(affinity.translate(outline, *place), 0.00004, 0.0003):
                    self.add(pose, yaw_rad, place)
                return

    def lay_foreign(self, kind):
        vertices, faces, reflectance = foreign_thing(kind, self.shape, self.random)
        vertices = turned(vertices, 0, 0, self.random.uniform(0, 2 * math.pi))
        outline = MultiPoint(vertices[:, :2]).convex_hull
        place = self.free_place(outline, 0.0015)
        if place:
            self.outlines.append(affinity.translate(outline, *place))
            self.foreign.append(({"kind": kind, "x_m": place[0], "y_m": place[1]}, vertices, faces, reflectance))

    def truth(self):
        parts = []
        for index, part in enumerate(self.parts):
            others = [self.outlines[index].distance(other) for i, other in enumerate(self.outlines) if i != index]
            to_wall_m, to_edge_m = self.setting.gaps_m(self.outlines[index])
            gap_m = min([*others, 0.02])
            wanted = self.shape["poses"][part["pose"]]["is_wanted"]
            isolated = bool(wanted and min(gap_m, to_wall_m) >= CLEARANCE_M and to_edge_m > 0.001)
            parts.append({**part, "gap_m": round(gap_m, 5), "isolated": isolated})
        return parts, [thing for thing, *_ in self.foreign]

    def meshes(self, kind):
        """What lies there, a hair above the plateau."""
        x_m, y_m, z_m = self.setting.x_m, self.setting.y_m, self.setting.plateau_m + 1e-5
        reflectances = np.array(self.shape["reflectance"])
        triangles = np.array(self.shape["triangles"])
        for reflectance in np.unique(reflectances):
            faces = triangles[reflectances == reflectance]
            for part in self.parts:
                place = (part["x_m"] + x_m, part["y_m"] + y_m, part["yaw_rad"])
                vertices = turned(self.shape["poses"][part["pose"]]["vertices_m"], *place) + [0, 0, z_m]
                yield mesh(vertices, faces, bsdf=surface(reflectance, kind))
        for thing, vertices, faces, reflectance in self.foreign:
            vertices = vertices + [thing["x_m"] + x_m, thing["y_m"] + y_m, z_m]
            yield mesh(vertices, faces, bsdf=surface(reflectance, kind if thing["kind"] == "lookalike" else "matt"))


def picture(setting, shape, name, plan, samples):
    """A picture, and what is known of it."""
    layout_name, light, kind, _ = plan
    random = np.random.default_rng(int(hashlib.sha256(name.encode()).hexdigest()[:12], 16))
    layout = Layout(setting, shape, random)
    apart, gap_m, against, foreign_kinds = LAYOUTS[layout_name]
    for _ in range(apart):
        layout.lay_apart(gap_m)
    for _ in range(against):
        layout.lay_against_another()
    for foreign_kind in foreign_kinds:
        layout.lay_foreign(foreign_kind)
    scene = {"type": "scene", "integrator": {"type": "path", "max_depth": 8, "hide_emitters": True}}
    things = [*setting.tray(), *layout.meshes(kind)]
    scene.update({f"thing_{index}": thing for index, thing in enumerate(things)})
    scene["sensor"] = setting.sensor(samples)
    light_seen = 0.0
    for emitters in setting.lights(light):
        lit = {**scene, **{f"emitter_{index}": emitter for index, emitter in enumerate(emitters)}}
        image = mi.render(mi.load_dict(lit), seed=int(random.integers(1 << 30)))
        light_seen = light_seen + np.array(image).reshape(setting.height_px, setting.width_px)
    sigma = random.uniform(2, 4)
    levels = light_seen * PLATEAU_GREY / np.median(light_seen[setting.plateau()])
    levels = np.clip(np.round(levels + random.normal(0, sigma, levels.shape)), 0, 255).astype(np.uint8)
    parts, foreign = layout.truth()
    # As the shared form has it: `teach`, `all` or `few`, and gloss told in the layout's name.
    told = layout_name.removeprefix("check_") + ("" if kind == "matt" else f"_{kind}")
    truth = {"picture": name, "light": light, "layout": told, "surface": kind, "noise_sigma_grey": round(sigma, 2)}
    return Image.fromarray(levels), {**truth, "parts": parts, "foreign": foreign}


def lamp_rad(text):
    """Elevation above the plateau and azimuth from the platen's x, rad."""
    elevation_deg, azimuth_deg = (float(number) for number in text.split(","))
    if not 10 <= elevation_deg <= 90:
        raise argparse.ArgumentTypeError(f"an elevation of {elevation_deg:g} degrees, allowed: 10 to 90")
    return math.radians(elevation_deg), math.radians(azimuth_deg)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="+", help="parts of the catalogue")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for the pictures and truth.json")
    parser.add_argument("--scenario", help="scenario (YAML); the built-in one without it")
    parser.add_argument("--samples", type=int, default=24, help="light paths a pixel and group of lamps")
    parser.add_argument("--lamps", nargs="+", type=lamp_rad, help="ELEVATION,AZIMUTH of low lamps, degrees")
    parser.add_argument("--few", action="store_true", help="few parts among things that look alike")
    args = parser.parse_args()
    lamps = {f"side{number}": lamp for number, lamp in enumerate(args.lamps or [], start=1)}
    plans = [("check_all", name, "matt", 1) for name in lamps] or (FEW if args.few else PLAN)
    options = ["--scenario", args.scenario] if args.scenario else []
    scene = json.loads(subprocess.run([LAB, "scene", *options, *args.parts], check=True, stdout=subprocess.PIPE).stdout)
    setting = Setting(scene, lamps)
    file = args.out / "truth.json"
    truths = json.loads(file.read_text()) if file.exists() else []
    known = {truth["picture"] for truth in truths}
    for part in args.parts:
        (args.out / part).mkdir(parents=True, exist_ok=True)
        for plan in plans:
            layout, light, kind, count = plan
            for index in range(count):
                name = f"{part}/{layout}_{light}_{kind}_{index:02}.jpg"
                if name in known:
                    continue
                image, truth = picture(setting, scene["parts"][part], name, plan, args.samples)
                image.save(args.out / name, quality=85)
                truths.append({**truth, "part": part})
                file.write_text(json.dumps(truths, indent=0))
                print(name, flush=True)


if __name__ == "__main__":
    main()
