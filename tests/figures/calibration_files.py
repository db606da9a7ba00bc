"""Known cameras, and each format of calibrations written as its own programs write it."""

import json
import math

import cv2
import numpy as np

from storage.formats.calibration.camera import Camera

NAMES = ("01", "2", "side")


def looking_at(name, where, target=(0.1, 1.0, -0.2), *, seed=0, distortion=(), up=(0, 1, 0)):
    """A camera at `where` that looks at `target`, upright; independent of the readers."""
    rng = np.random.default_rng(seed)
    ahead = np.subtract(target, where).astype(float)
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(ahead, right), ahead])
    focal = 500 + rng.uniform(-30, 30, 2)
    center = np.array([320.0, 240.0]) + rng.uniform(-9, 9, 2)
    matrix = np.array([[focal[0], 0, center[0]], [0, focal[1], center[1]], [0, 0, 1]])
    return Camera(name, (640, 480), matrix, np.array(distortion), rotation, -rotation @ where)


def rig(distortion=(-0.11, 0.03, 0.001, -0.002)):
    """Three cameras of a y-up world, metres, around a dancer."""
    places = [(3.5, 1.6, 0.4), (-1.0, 2.4, 3.1), (-2.2, 0.7, -2.9)]
    return [
        looking_at(name, place, seed=seed, distortion=distortion)
        for seed, (name, place) in enumerate(zip(NAMES, places, strict=True))
    ]


def in_z_up(camera):
    """(rotation, translation) of a camera in the world whose z points up: (x, -z, y)."""
    y_up_from_z_up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    return camera.rotation @ y_up_from_z_up, camera.translation


def vector(rotation):
    return cv2.Rodrigues(rotation)[0].ravel()


def write_pose2sim(folder, cameras, *, scale=1.0, metadata="adjusted = false\nerror = 0.0\n"):
    text = ""
    for camera in cameras:
        text += (
            f'[cam_{camera.name}]\nname = "{camera.name}"\nsize = [{camera.width}.0, '
            f"{camera.height}.0]\nmatrix = {camera.intrinsics.tolist()}\n"
            f"distortions = {[*camera.distortion.tolist()]}\n"
            f"rotation = {vector(camera.rotation).tolist()}\n"
            f"translation = {(camera.translation * scale).tolist()}\nfisheye = false\n\n"
        )
    path = folder / "calibration.toml"
    path.write_text(text + f"[metadata]\n{metadata}")
    return path


def write_easymocap(folder, cameras, *, scale=1.0, layout="both", with_size=True, digits=17):
    """`layout`: both rotations, the vector under Rot_, only the vector, or only the matrix."""
    inner, outer = ("%YAML:1.0\n---\nnames:\n" for _ in range(2))
    listed = "".join(f'  - "{camera.name}"\n' for camera in cameras)
    inner, outer = inner + listed, outer + listed
    for camera in cameras:
        bent = np.pad(camera.distortion, (0, 5 - len(camera.distortion)))
        inner += matrix_yaml(f"K_{camera.name}", camera.intrinsics)
        inner += matrix_yaml(f"dist_{camera.name}", bent[None])
        if with_size:
            inner += f"H_{camera.name}: {camera.height}\nW_{camera.name}: {camera.width}\n"
        turn = vector(camera.rotation)[:, None]
        if layout in ("both", "vector"):
            outer += matrix_yaml(f"R_{camera.name}", turn)
        if layout in ("both", "matrix"):
            outer += matrix_yaml(f"Rot_{camera.name}", camera.rotation.round(digits))
        if layout == "vector under Rot_":
            outer += matrix_yaml(f"Rot_{camera.name}", turn)
        outer += matrix_yaml(f"T_{camera.name}", camera.translation[:, None] * scale)
    (folder / "intri.yml").write_text(inner)
    (folder / "extri.yml").write_text(outer)
    return folder / "extri.yml"


def matrix_yaml(name, matrix):
    rows, columns = matrix.shape
    data = ", ".join(repr(float(value)) for value in matrix.ravel())
    return (
        f"{name}: !!opencv-matrix\n  rows: {rows}\n  cols: {columns}\n  dt: d\n  data: [{data}]\n"
    )


def write_opencv(folder, cameras, *, suffix=".yml", keys=None, scale=1.0):
    """A file a camera, by OpenCV itself."""
    keys = keys or ("camera_matrix", "distortion_coefficients", "R", "T")
    folder = folder / "calibration"
    folder.mkdir()
    for camera in cameras:
        bent = camera.distortion if len(camera.distortion) else np.zeros(5)
        file = cv2.FileStorage(str(folder / f"{camera.name}{suffix}"), cv2.FILE_STORAGE_WRITE)
        file.write("image_width", camera.width)
        file.write("image_height", camera.height)
        file.write("calibration_time", "Tue 3 Mar 2026: late")
        file.write(keys[0], camera.intrinsics)
        file.write(keys[1], bent[None])
        file.write(keys[2], camera.rotation if keys[2] == "R" else vector(camera.rotation))
        file.write(keys[3], camera.translation * scale)
        file.release()
    return folder


def write_qualisys(folder, cameras, *, swapped=(), offset=(0, 0)):
    """Millimetres, z up; camera to world, looking along -z, written by column."""
    half_turn = np.diag([1.0, -1.0, -1.0])
    text = '<?xml version="1.0" encoding="UTF-8"?>\n<calibration qtm-version="2023"><cameras>\n'
    text += '<camera active="1" serial="9" model="Arqus A12"><fov_video left="0"/></camera>\n'
    for camera in cameras:
        rotation, translation = in_z_up(camera)
        world_from_camera = (half_turn @ rotation).T
        center = -rotation.T @ translation * 1000
        fu, fv, cu, cv = (camera.intrinsics[at] * 64 for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
        cu, cv = cu + 64 * offset[0], cv + 64 * offset[1]
        k1, k2, p1, p2 = (*camera.distortion, 0, 0, 0, 0)[:4]
        if camera.name in swapped:
            fu, fv, cu, cv, p1, p2 = fv, fu, cv, cu, p2, p1
        cells = (
            " ".join(
                f'r{row + 1}{column + 1}="{world_from_camera[column, row]!r}"'.replace(
                    "np.float64", ""
                )
                for row in range(3)
                for column in range(3)
            )
            .replace("(", "")
            .replace(")", "")
        )
        text += (
            f'<camera active="1" serial="{camera.name}" model="Miqus Video" viewrotation="0">\n'
            f'<fov_video left="{offset[0]}" top="{offset[1]}" '
            f'right="{offset[0] + camera.width - 1}" bottom="{offset[1] + camera.height - 1}"/>\n'
            f'<transform x="{center[0]}" y="{center[1]}" z="{center[2]}" {cells}/>\n'
            f'<intrinsic focalLengthU="{fu}" focalLengthV="{fv}" centerPointU="{cu}" '
            f'centerPointV="{cv}" skew="0" radialDistortion1="{k1}" radialDistortion2="{k2}" '
            f'radialDistortion3="0" tangentalDistortion1="{p1}" tangentalDistortion2="{p2}"/>\n'
            "</camera>\n"
        )
    path = folder / "calibration.qca.txt"
    path.write_text(text + "</cameras></calibration>\n")
    return path


def write_panoptic(folder, cameras):
    """Centimetres, y down."""
    y_up_from_y_down = np.diag([1.0, -1.0, -1.0])
    listed = [
        {
            "name": camera.name, "type": "hd", "resolution": [camera.width, camera.height],
            "panel": 0, "node": number, "K": camera.intrinsics.tolist(),
            "distCoef": [*camera.distortion, *[0] * (5 - len(camera.distortion))],
            "R": (camera.rotation @ y_up_from_y_down).tolist(),
            "t": (camera.translation[:, None] * 100).tolist(),
        }
        for number, camera in enumerate(cameras)
    ]  # fmt: skip
    path = folder / "calibration.json"
    path.write_text(json.dumps({"calibDataSource": "test", "cameras": listed}))
    return path


def write_colmap(folder, cameras, *, model="OPENCV"):
    """The first pixel's center at (.5, .5); a line of points behind each image."""
    lenses = "# Camera list with one line of data per camera:\n"
    images = "# Image list with two lines of data per image:\n"
    for number, camera in enumerate(cameras, start=4):
        (fx, _, cx), (_, fy, cy), _ = camera.intrinsics
        values = [fx, fy, cx + 0.5, cy + 0.5]
        if model == "OPENCV":
            values += (*camera.distortion, 0, 0, 0, 0)[:4]
        lenses += f"{number} {model} {camera.width} {camera.height} "
        lenses += " ".join(repr(float(value)) for value in values) + "\n"
        turn = vector(camera.rotation)
        angle = np.linalg.norm(turn)
        quaternion = [math.cos(angle / 2), *(turn / angle * math.sin(angle / 2))]
        pose = " ".join(repr(float(value)) for value in (*quaternion, *camera.translation))
        points = "" if number == 5 else "10.5 20.5 -1 30.25 40.5 7"
        images += f"{number + 10} {pose} {number} {camera.name}.png\n{points}\n"
    (folder / "cameras.txt").write_text(lenses)
    (folder / "images.txt").write_text(images)
    return folder / "images.txt"


def write_matrices(folder, cameras, *, suffix=".xml", factor=-2.5):
    """A file a camera, in another scale and sign."""
    folder = folder / "calibration"
    folder.mkdir()
    for camera in cameras:
        pose = np.column_stack([camera.rotation, camera.translation])
        numbers = " ".join(f"{value:.12g}" for value in (factor * camera.intrinsics @ pose).ravel())
        if suffix == ".xml":
            numbers = f'<?xml version="1.0" encoding="UTF-8" ?>\n<camera>\n{numbers}\n</camera>\n'
        (folder / f"{camera.name}{suffix}").write_text(numbers)
    return folder


def write_surrey(folder, cameras, *, orders=1, rows_first=True):
    """Metres; the ends of rows and columns, then lens, distortion, rotation and translation."""
    lines = [f"{len(cameras)} {orders}"]
    for camera in cameras:
        rows, columns = f"0 {camera.height - 1}", f"0 {camera.width - 1}"
        lines.append(f"{rows} {columns}" if rows_first else f"{columns} {rows}")
        k = camera.intrinsics
        lines.append(" ".join(repr(float(v)) for v in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])))
        bent = np.pad(camera.distortion, (0, 5 - len(camera.distortion)))[[0, 1, 4]]
        lines.append(" ".join(repr(float(v)) for v in bent[:orders]))
        lines += [" ".join(repr(float(v)) for v in row) for row in camera.rotation]
        lines.append(" ".join(repr(float(v)) for v in camera.translation))
    path = folder / "calibration.txt"
    path.write_text("\n".join(lines) + "\n")
    return path
