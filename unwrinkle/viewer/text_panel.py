"""Panels with text or a picture as scene objects; Meshcat has no text of its own."""

import base64
import json
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

# Height of a line, margin, and maximum width of a picture, pixels.
_LINE = 44
_MARGIN = 24
_WIDEST = 640
_MEDIA = {".png": "image/png", ".jpg": "image/jpeg"}
#: Scale of OpenCV's font for that height of a line.
_SCALE = 1.05


def text_panel(lines: list[tuple[str, str]], height: float) -> Any:
    """Build a text panel in its x, z plane, facing -y, lower edge centred on the origin.

    Args:
        lines: texts and their colours, #rrggbb.
        height: height of the panel, m.

    Returns:
        Shape for `Meshcat.SetObject`; its width follows from the texts.
    """
    return _textured(_picture(lines), height, ".png")


def picture_panel(picture: NDArray[np.uint8], height: float) -> Any:
    """Build a panel with a picture (h, w, 3) RGB, placed as `text_panel`.

    Large pictures are reduced.
    """
    rows, columns = picture.shape[:2]
    zoom = min(1.0, _WIDEST / columns)
    size = (max(1, round(zoom * columns)), max(1, round(zoom * rows)))
    return _textured(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), height, ".jpg")


def _textured(image: Any, height: float, kind: str) -> Any:
    aspect = image.shape[1] / image.shape[0]
    ok, encoded = cv2.imencode(kind, np.ascontiguousarray(image[..., ::-1]))
    if not ok:
        raise RuntimeError(f"OpenCV cannot write {kind}")
    # glTF's y axis points up; Drake converts it.
    x, y = 0.5 * aspect * height, height
    corners = np.array([[-x, 0, 0], [x, 0, 0], [x, y, 0], [-x, y, 0]], dtype="<f4")
    texture = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype="<f4")
    faces = np.array([0, 1, 2, 0, 2, 3], dtype="<u2")
    parts = [corners.tobytes(), texture.tobytes(), faces.tobytes()]
    offsets = np.cumsum([0] + [len(part) for part in parts])
    document = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}
                ]
            }
        ],
        "materials": [
            {
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}},
                "extensions": {"KHR_materials_unlit": {}},
                "doubleSided": True,
            }
        ],
        "textures": [{"source": 0}],
        "images": [{"uri": _data(_MEDIA[kind], encoded.tobytes())}],
        "buffers": [
            {
                "uri": _data("application/octet-stream", b"".join(parts)),
                "byteLength": int(offsets[-1]),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(offset), "byteLength": len(part)}
            for offset, part in zip(offsets[:-1], parts, strict=True)
        ],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 4,
                "type": "VEC3",
                "min": corners.min(axis=0).tolist(),
                "max": corners.max(axis=0).tolist(),
            },
            {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
            {"bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
    }
    file = MemoryFile(json.dumps(document), ".gltf", "panel.gltf")
    return Mesh(InMemoryMesh(mesh_file=file))


def _picture(lines: list[tuple[str, str]]) -> Any:
    font = cv2.FONT_HERSHEY_SIMPLEX
    widths = [cv2.getTextSize(text, font, _SCALE, 2)[0][0] for text, _ in lines]
    shape = (2 * _MARGIN + _LINE * len(lines), 2 * _MARGIN + max(widths), 3)
    image = np.full(shape, 250, dtype=np.uint8)
    cv2.rectangle(image, (0, 0), (shape[1] - 1, shape[0] - 1), (140, 150, 165), 4)
    for k, (text, colour) in enumerate(lines):
        rgb = tuple(int(colour[i : i + 2], 16) for i in (1, 3, 5))
        place = (_MARGIN, _MARGIN + _LINE * k + round(0.75 * _LINE))
        cv2.putText(image, text, place, font, _SCALE, rgb, 2, cv2.LINE_AA)
    return image


def _data(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
