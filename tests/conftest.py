"""Makes the checks of shapes that pyproject.toml asks for cheaper, before anything is imported."""

from __future__ import annotations

import jaxtyping
import pytest
from shape_checks import checked

pytest.MonkeyPatch().setattr(jaxtyping, "jaxtyped", checked)
