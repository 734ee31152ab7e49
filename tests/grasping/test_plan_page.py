import base64
import re
from pathlib import Path

import numpy as np
import pytest
import umsgpack

from poil_drake.grasping.plan_page import write_plan_page
from poil_drake.grasping.planner import PlanningResult

X_WB = np.diag([-1.0, -1.0, 1.0, 1.0])  # The robot stands the other way round.


@pytest.fixture(scope="module")
def page(planned: PlanningResult, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "new" / "plan.html"
    write_plan_page(path, planned, X_WB=X_WB)
    return path.read_text()


@pytest.fixture(scope="module")
def commands(page: str) -> list[dict]:
    """What the page tells meshcat's viewer."""
    found = re.search(r"for \(const command of \[(.*)\]\)", page)
    assert found is not None
    packed = [base64.b64decode(text) for text in re.findall(r"'([^']+)'", found[1])]
    return [umsgpack.unpackb(command) for command in packed]
