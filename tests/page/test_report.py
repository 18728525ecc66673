"""The report that `run` writes, as somebody opens it on a phone."""

import re
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import Browser

from support.map_page import RECORDING
from support.near_ground import write_near_ground


def test_on_a_phone_no_area_is_cut_off_and_no_crowd_has_a_probability_of_zero(
    browser: Browser, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "crowdfence", "run", str(RECORDING), "--detector", "recorded"]
    command += ["--terrain", str(write_near_ground(tmp_path))]
    subprocess.run([*command, "-o", str(tmp_path / "out")], check=True, capture_output=True)
    context = browser.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    page.goto((tmp_path / "out" / "report.html").as_uri())
    ground = page.locator("section", has_text="What is known of the ground in view")
    sheet = ground.bounding_box()
    assert sheet is not None
    areas = ground.locator("td.number").all()
    assert len(areas) == 6
    for area in areas:
        box = area.bounding_box()
        assert box is not None and box["x"] + box["width"] <= sheet["x"] + sheet["width"], area.inner_text()
    shown = page.locator("td.number:nth-child(5)").all_inner_texts()
    assert any(re.fullmatch(r"0\.00[1-9]", value.strip()) for value in shown)
    assert not {"0.00", "1.00"} & {value.strip() for value in shown}
    context.close()
