"""What a placement looks like, small, on the page of its flow run; imports Prefect.

Browsers do not load files for pages that come from a server, so the pictures are in the text itself.
"""

import base64
import io
from pathlib import Path
from uuid import UUID

from PIL import Image
from prefect.logging import get_run_logger

from dcap.scene.errors import StoreError
from dcap.scene.store.artifacts import Store
from dcap.scene.store.pictures import picture_from_png
from flows.place import PlacementRefs
from flows.run_artifacts import RunArtifacts

SIDE = 320
"""Of a picture [pixels]: four of them are 100 KB of the server's database."""
QUALITY = 80
SHOWN = ("settled", "closeup", "before_after", "asked", "clean", "candidates", "hole")
"""Pictures by what they are called in a sample's folder, the most telling first."""
MOST = 3


def show_pictures(placement: PlacementRefs, run_id: UUID) -> None:
    """Put pictures of a placement on the page of its flow run."""
    folder = Store.default().folder(placement.overview or placement.renders)
    paths = [path for name in SHOWN if (path := folder / f"{name}.png").is_file()][:MOST]
    try:
        parts = [f"**{path.stem.replace('_', ' ')}**\n\n![{path.stem}]({data_url(path)})" for path in paths]
    except (OSError, StoreError) as error:  # damaged meanwhile: the sample is placed all the same
        get_run_logger().warning("pictures are not shown: %s", error)
        return
    if parts:
        RunArtifacts(run_id).put("pictures", "markdown", "\n\n".join(parts))


def data_url(path: Path) -> str:
    """A picture of the store as a small JPEG inside of an address."""
    small = Image.fromarray(picture_from_png(path.read_bytes(), path.name)).convert("RGB")
    small.thumbnail((SIDE, SIDE))
    data = io.BytesIO()
    small.save(data, "JPEG", quality=QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(data.getvalue()).decode()}"
