"""The child process that runs pycolmap: one task of one request. It must not import torch.

Read from stdin: a JSON object with `task`, the name of a function below, and its arguments. Written
to stdout: JSON lines of type "step" (step, steps, note), then "done" with the answer, or "error".
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

BATCH = 200
"""Pairs that are matched before their result is written."""
LARGEST = 300
"""Largest features of a photo, which tell what photos show the same: 1 % of the work of all. Of the
bear's pairs with 60 verified matches, 95 % have 12 of them in common; of pairs without a match,
1 % have 9."""
NEXT = 0.8
"""A feature's distance from its match, as a share of that from the next (COLMAP's default)."""
GOOD_ERROR = 2.0
"""Pixels: the largest reprojection error of a point that the fit starts from."""
GOOD_ANGLE = 2.0
"""Degrees: the smallest angle between its rays."""
ENOUGH_FOR_CENTER = 15
"""Photos of one camera from which the principal point is estimated too. The bear's lies 17 pixels
off the middle of 512: left there, every pose is 1.7 degrees wrong."""
FARTHEST_CENTER = 0.1
"""Largest distance of a believable principal point from the middle, as a share of the picture's
side."""

Say = Callable[..., None]


def extract(say: Say, database: str, images: str, groups: list[dict], features: int, peak: float,
            affine: bool, size: int, threads: int) -> dict[str, Any]:  # fmt: skip
    """SIFT features of each group of photos, which share a camera; goes on in a database."""
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads, options.max_image_size, options.use_gpu = threads, size, False
    options.sift.max_num_features = features
    options.sift.peak_threshold = peak
    options.sift.estimate_affine_shape = affine
    for group in groups:
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = group["model"]
        if group["params"]:
            reader.camera_params = ",".join(map(str, group["params"]))
        known = _camera_of(database, group["names"])
        if known is not None:
            reader.existing_camera_id = known
        pycolmap.extract_features(
            database, images, group["names"], pycolmap.CameraMode.SINGLE, reader, options,
            pycolmap.Device.cpu,
        )  # fmt: skip
    return {}


def _camera_of(database: str, names: Sequence[str]) -> int | None:
    """The camera of photos that an interrupted run has entered already."""
    if not Path(database).exists():
        return None
    with pycolmap.Database.open(database) as opened:
        found = (opened.read_image_with_name(name) for name in names)
        return next((image.camera_id for image in found if image is not None), None)


def common(say: Say, database: str, names: list[str], threads: int) -> dict[str, Any]:
    """How many of the largest features each photo has in common with each of those before it."""
    with pycolmap.Database.open(database) as opened:
        images = {image.name: image.image_id for image in opened.read_all_images()}
        photos = [_largest(opened, images[name]) for name in names]
    counts = []
    for i, photo in enumerate(photos):
        say("step", step=i, steps=len(photos))
        counts.append([_in_common(photo, before) for before in photos[:i]])
    return {"common": counts}


def _largest(opened: pycolmap.Database, image: int) -> np.ndarray:
    """Descriptors [n, 128] of unit length of a photo's largest features."""
    shapes = opened.read_keypoints(image)[:, 2:].reshape(-1, 2, 2)
    order = np.argsort(-np.abs(np.linalg.det(shapes)), kind="stable")[:LARGEST]
    found = opened.read_descriptors(image).data[order].astype(np.float32)
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def _in_common(first: np.ndarray, second: np.ndarray) -> int:
    """Features that are each other's nearest, and nearer than the next by far."""
    if min(len(first), len(second)) < 2:
        return 0
    cosine = first @ second.T
    rows, nearest = np.arange(len(first)), cosine.argmax(1)
    mutual = cosine.argmax(0)[nearest] == rows
    best = cosine[rows, nearest]
    cosine[rows, nearest] = -1
    return int((mutual & (1 - best < NEXT**2 * (1 - cosine.max(1)))).sum())


def match(say: Say, database: str, pairs: str, guided: bool, seed: int, threads: int
          ) -> dict[str, Any]:  # fmt: skip
    """Match and verify the pairs of a list; those in the database already are left out."""
    options = pycolmap.FeatureMatchingOptions()
    options.num_threads, options.use_gpu, options.guided_matching = threads, False, guided
    pairing = pycolmap.ImportedPairingOptions()
    pairing.match_list_path, pairing.block_size = pairs, BATCH
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = seed
    pycolmap.match_image_pairs(database, options, pairing, verification, pycolmap.Device.cpu)
    return survey(database)


def survey(database: str) -> dict[str, Any]:
    """Evidence in the features and matches for why photos could not be posed."""
    with pycolmap.Database.open(database) as opened:
        images = {image.image_id: image for image in opened.read_all_images()}
        cameras = {camera.camera_id: camera for camera in opened.read_all_cameras()}
        keypoints = {i: opened.read_keypoints(i)[:, :2] for i in images}
        pairs = []
        for pair, geometry in zip(*opened.read_two_view_geometries()):
            inliers = geometry.inlier_matches
            if not len(inliers):
                continue
            i, j = pycolmap.pair_id_to_image_pair(pair)
            moved = keypoints[i][inliers[:, 0]] - keypoints[j][inliers[:, 1]]
            camera = cameras[images[i].camera_id]
            pairs.append({
                "names": (images[i].name, images[j].name),
                "inliers": len(inliers),
                "flat": geometry.config in _FLAT,
                "shift": float(np.median(np.linalg.norm(moved, axis=1))) / camera.width,
                "homography": None
                if geometry.H is None
                else _centered(geometry.H, camera).tolist(),
            })  # fmt: skip
    counts = {image.name: len(keypoints[i]) for i, image in images.items()}
    return {"features": counts, "pairs": pairs}


def points(say: Say, database: str, images: str, groups: list[dict], features: int, peak: float,
           size: int, pairs: str, threads: int) -> dict[str, Any]:  # fmt: skip
    """Positions of the verified matches of a list of pairs, in both photos of each."""
    extract(say, database, images, groups, features, peak, False, size, threads)
    match(say, database, pairs, False, 0, threads)
    with pycolmap.Database.open(database) as opened:
        names = {image.image_id: image.name for image in opened.read_all_images()}
        keypoints = {i: opened.read_keypoints(i)[:, :2] for i in names}
        found = []
        for pair, geometry in zip(*opened.read_two_view_geometries()):
            ids, inliers = pycolmap.pair_id_to_image_pair(pair), geometry.inlier_matches
            if len(inliers):
                first, second = (keypoints[i][inliers[:, k]] for k, i in enumerate(ids))
                both = [names[i] for i in ids]
                found.append({"names": both, "first": first.tolist(), "second": second.tolist()})
    return {"pairs": found}


_FLAT = {
    int(pycolmap.TwoViewGeometryConfiguration.__members__[name])
    for name in ("PLANAR", "PANORAMIC", "PLANAR_OR_PANORAMIC")
}
"""Pairs that a homography explains: a flat subject, or a camera that only turned."""


def _centered(homography: np.ndarray, camera: pycolmap.Camera) -> np.ndarray:
    """The homography between pictures whose origin is the middle and whose unit is the width."""
    half = np.array([camera.width, camera.height]) / 2
    to_unit = np.diag([1 / camera.width, 1 / camera.width, 1.0])
    to_unit[:2, 2] = -half / camera.width
    return to_unit @ homography @ np.linalg.inv(to_unit)


def map_incrementally(say: Say, database: str, images: str, output: str, count: int,
                      seed: int, threads: int) -> dict[str, Any]:  # fmt: skip
    """Incremental mapping; the models, each in a folder of its own below `output`."""
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed, options.min_model_size = threads, seed, 3
    options.extract_colors = False  # of the model that is kept only
    placed = 0

    def place(number: int) -> None:
        nonlocal placed
        placed += number
        say("step", step=min(placed, count - 1), steps=count)  # photos may be in several models

    Path(output).mkdir(parents=True)
    models = pycolmap.incremental_mapping(
        database, images, output, options,
        initial_image_pair_callback=lambda: place(2), next_image_callback=lambda: place(1),
    )  # fmt: skip
    return {"models": [_model(index, model) for index, model in models.items()]}


def _model(index: int, model: pycolmap.Reconstruction) -> dict[str, Any]:
    posed = [image for image in model.images.values() if image.has_pose]
    return {
        "folder": str(index),
        "points": model.num_points3D(),
        "error": model.compute_mean_reprojection_error(),
        "poses": {image.name: image.cam_from_world().matrix().tolist() for image in posed},
    }


def refine(say: Say, model: str, database: str, images: str, output: str, seed: int, threads: int
           ) -> dict[str, Any]:  # fmt: skip
    """The model with the principal points of cameras that took many photos, and with points that
    only two photos see where that gives more good ones."""
    say("step", step=0, steps=2, note="principal point")
    reconstruction = _with_centers(pycolmap.Reconstruction(model), threads)
    say("step", step=1, steps=2, note="points")
    reconstruction = _with_more_points(reconstruction, database, images, output, seed, threads)
    reconstruction.extract_colors_for_all_images(images, threads)
    folder = Path(output)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    reconstruction.write(folder)
    say("step", step=2, steps=2)
    posed = [image for image in reconstruction.images.values() if image.has_pose]
    cameras = []
    for number, name in {image.camera_id: image.name for image in posed}.items():
        camera = reconstruction.cameras[number]
        focal, width, height = camera.mean_focal_length(), camera.width, camera.height
        cameras.append({"photo": name, "focal": focal, "width": width, "height": height})
    return {**_model(0, reconstruction), "cameras": cameras}


def _with_centers(reconstruction: pycolmap.Reconstruction, threads: int) -> pycolmap.Reconstruction:
    """Adjusted with the principal points of cameras free that took enough photos, the intrinsics of
    others held; as it was, where a point comes out far from the middle or the error is not less."""
    uses: dict[int, int] = {}
    adjusted = pycolmap.BundleAdjustmentConfig()
    for image in reconstruction.images.values():
        if image.has_pose:
            uses[image.camera_id] = uses.get(image.camera_id, 0) + 1
            adjusted.add_image(image.image_id)
    if max(uses.values()) < ENOUGH_FOR_CENTER:
        return reconstruction
    for camera, number in uses.items():
        if number < ENOUGH_FOR_CENTER:
            adjusted.set_constant_cam_intrinsics(camera)
    adjusted.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_principal_point, options.print_summary = True, False
    options.ceres.solver_options.num_threads = threads
    tried = pycolmap.Reconstruction(reconstruction)
    pycolmap.create_default_bundle_adjuster(options, adjusted, tried).solve()
    for camera in tried.cameras.values():
        size = np.array([camera.width, camera.height])
        off = np.abs([camera.principal_point_x, camera.principal_point_y] - size / 2)
        if (off > FARTHEST_CENTER * size).any():
            return reconstruction
    tried.update_point_3d_errors()
    return min(tried, reconstruction, key=lambda each: each.compute_mean_reprojection_error())


def _with_more_points(reconstruction: pycolmap.Reconstruction, database: str, images: str,
                      output: str, seed: int, threads: int) -> pycolmap.Reconstruction:  # fmt: skip
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads, options.random_seed, options.extract_colors = threads, seed, False
    options.triangulation.ignore_two_view_tracks = False
    Path(output).mkdir(parents=True, exist_ok=True)
    dense = pycolmap.triangulate_points(
        pycolmap.Reconstruction(reconstruction), database, images, output, True, options
    )
    for each in (reconstruction, dense):
        pycolmap.ObservationManager(each).filter_all_points3D(GOOD_ERROR, GOOD_ANGLE)
        each.update_point_3d_errors()
    return max(dense, reconstruction, key=lambda each: each.num_points3D())


def undistort(say: Say, model: str, images: str, output: str, rotation: list[list[float]],
              size: int, threads: int) -> dict[str, Any]:  # fmt: skip
    """A COLMAP folder: images/ of pinhole cameras, at most `size` pixels, and sparse/0, in a world
    that is turned."""
    reconstruction = pycolmap.Reconstruction(model)
    turn = pycolmap.Sim3d(1.0, pycolmap.Rotation3d(np.array(rotation)), np.zeros(3))
    reconstruction.transform(turn)
    folder = Path(output)
    turned = folder / "turned"
    turned.mkdir(parents=True)
    reconstruction.write(turned)
    options = pycolmap.UndistortCameraOptions()
    options.max_image_size = size  # a barrel's corners reach farther out than the photo did
    pycolmap.undistort_images(
        folder, turned, images, undistort_options=options, jpeg_quality=95, num_threads=threads
    )
    shutil.rmtree(turned)
    (folder / "sparse").rename(folder / "model")
    (folder / "sparse").mkdir()
    (folder / "model").rename(folder / "sparse" / "0")
    for each in folder.iterdir():  # scripts and folders for COLMAP's dense stereo
        if each.name not in ("images", "sparse"):
            shutil.rmtree(each) if each.is_dir() else each.unlink()
    return {"images": len(list(folder.glob("images/*")))}


TASKS = {
    "features": extract,
    "pairs": common,
    "matches": match,
    "points": points,
    "mapping": map_incrementally,
    "refinement": refine,
    "undistortion": undistort,
}


def main() -> None:
    """Answer the request on stdin."""
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print goes to the log
    lock = threading.Lock()

    def say(kind: str, **record: Any) -> None:
        with lock:
            answers.write(json.dumps({"type": kind, **record}) + "\n")
            answers.flush()

    request = json.loads(sys.stdin.readline())
    task = request.pop("task")
    sys.stderr.write(f"{time.strftime('%F %T')} {task} {json.dumps(request)[:2000]}\n")
    sys.stderr.flush()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        answer = TASKS[task](say, **request)
    except Exception as error:  # of any kind: the parent names it
        traceback.print_exc()  # into the log
        say("error", message=str(error).split("\n")[0] or type(error).__name__)
    else:
        say("done", **answer)
    answers.flush()
    os._exit(0)  # the thread that reads stdin would hold the interpreter


def _end_with_parent() -> None:
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    main()
