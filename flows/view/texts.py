"""The panel's texts as HTML: verdict, certificate, contacts, materials, messages; from the keys of placement.json."""

from collections.abc import Iterator, Mapping, Sequence
from html import escape

from dcap.scene.types.choices import POSE_OF_THE_FILE, Rotation
from dcap.scene.written_files import JsonValue
from flows.placement_json import AS_POSED, AT_REST
from flows.view.model import DEEP, LEVEL, RAISED, MaterialCloud, css

STYLE = """<style>
.dcap { font-size: 12px; line-height: 1.45; overflow-x: auto; padding: 0 2px 6px 2px }
.dcap table { border-collapse: collapse; width: 100% }
.dcap td, .dcap th { text-align: left; padding: 2px 6px 2px 0; border-bottom: 1px solid rgba(128,128,128,.25);
  vertical-align: top; overflow-wrap: anywhere }
.dcap td.n, .dcap th.n { text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums }
.dcap .yes { color: #2b8a3e } .dcap .no { color: #c92a2a }
.dcap b.verdict { font-size: 15px }
.dcap h4 { margin: 10px 0 2px 0; font-size: 12.5px }
.dcap ul { margin: 2px 0; padding-left: 18px }
.dcap .bar { height: 12px; border-radius: 3px }
.dcap .ends { display: flex; justify-content: space-between }
.dcap .dot { display: inline-block; width: 10px; height: 10px; border-radius: 5px; margin-right: 6px }
</style>"""
UNITS = {
    "linear_speed": "m/s", "angular_speed": "rad/s", "particle_speed": "m/s", "center_drift": "m", "box_change": "m",
    "angle_rad": "rad", "distance_m": "m", "change_rad": "rad", "tilt_rad": "rad", "turn_rad": "rad",
}  # fmt: skip
"""Units of rows of the certificate; other rows are ratios."""
GROUPS = {"signals": "at rest", "kick": "after a kick", "placement": "as asked", "lean": "leans as asked"}


def page(*parts: str) -> str:
    """Wrap parts of the panel in their style."""
    return f'{STYLE}<div class="dcap">{"".join(parts)}</div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], numbers: Sequence[int] = ()) -> str:
    """A table of cells that are HTML already; the columns in `numbers` are right-aligned."""

    def line(cells: Sequence[str], tag: str) -> str:
        return "".join(
            f"<{tag}{' class=n' if column in numbers else ''}>{cell}</{tag}>" for column, cell in enumerate(cells)
        )

    body = "".join(f"<tr>{line(row, 'td')}</tr>" for row in rows)
    return f"<table><tr>{line(head, 'th')}</tr>{body}</table>"


def number(value: JsonValue) -> str:
    """A number with three digits; a dash for none."""
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, (int, float)) and not isinstance(value, bool) else escape(str(value))


def verdict(tree: Mapping[str, JsonValue]) -> str:
    """Verdict, reason and prompt."""
    said = {AT_REST: "at rest", AS_POSED: "as posed"}.get(str(tree["verdict"]))
    placed = said is not None
    said = said or f"infeasible: {escape(str(tree['reason']))}"
    message = f"<p>{escape(str(tree['message']))}</p>" if tree["message"] else ""
    return f'<b class="verdict {"yes" if placed else "no"}">{said}</b><p>{escape(str(tree["prompt"]))}</p>{message}'


def facts(tree: Mapping[str, JsonValue]) -> str:
    """Reading of the sentence."""
    rows, base = [], tree["base"]
    if isinstance(base, Mapping):
        rows.append(("on", f"{escape(str(base['label']))} ({escape(str(base['id']))})"))
    for key, unit in (("part", ""), ("region", ""), ("region_missed", ""), ("scale", ""), ("mass", " kg")):
        value = tree[key]
        if value is not None:
            shown = ("yes" if value else "no") if isinstance(value, bool) else number(value)
            rows.append((key.replace("_", " "), shown + unit))
    if tree["visible_fraction"] is not None:
        rows.append(("visible share", number(tree["visible_fraction"])))
    return table(("", ""), rows) if rows else ""


def certificate_rows(tree: JsonValue, group: str = "") -> Iterator[tuple[str, str, Mapping[str, JsonValue]]]:
    """Every number with a threshold: its group, name and row."""
    if not isinstance(tree, Mapping):
        return
    for name, value in tree.items():
        if not isinstance(value, Mapping):
            continue
        if {"value", "threshold"} <= set(value):
            yield group, name, value
        else:
            yield from certificate_rows(value, name)


def holds(row: Mapping[str, JsonValue]) -> bool:
    """Whether a number is on the right side of its threshold."""
    judged = row.get("margin")
    if isinstance(judged, (int, float)):
        return judged >= 0.0
    value, threshold = row["value"], row["threshold"]
    return isinstance(value, (int, float)) and isinstance(threshold, (int, float)) and value <= threshold


def mark(good: bool) -> str:
    """A tick or a cross."""
    return '<span class="yes">&#10003; holds</span>' if good else '<span class="no">&#10007; fails</span>'


def certificate(tree: JsonValue) -> str:
    """Every number with its threshold, then the numbers without one."""
    if not isinstance(tree, Mapping) or not tree:
        return "<p>There is no certificate: nothing was dropped.</p>"
    rows = [
        (escape(f"{GROUPS.get(group, group)}: {name.removesuffix('_rad').removesuffix('_m').replace('_', ' ')}"),
         number(row["value"]), number(row["threshold"]), UNITS.get(name, ""), mark(holds(row)))
        for group, name, row in certificate_rows(tree)
    ]  # fmt: skip
    kick = tree.get("kick")
    if isinstance(kick, Mapping):
        if kick.get("done"):
            rows.append(("after a kick: stable", "", "", "", mark(bool(kick.get("stable")))))
        else:
            rows.append(("kick", "not done", "", "", escape(str(kick.get("reason") or ""))))
    plain = [
        (escape(name.replace("_", " ")), number(value))
        for name, value in tree.items()
        if value is not None and not isinstance(value, (Mapping, list))
    ]
    judged = table(("", "value", "threshold", "", ""), rows, (1, 2)) if rows else ""
    return judged + (f"<h4>further numbers</h4>{table(('', ''), plain, (1,))}" if plain else "")


def contacts(rows: JsonValue) -> str:
    """The table of contacts."""
    if not isinstance(rows, list) or not rows:
        return "<p>Nothing touches.</p>"
    cells = [
        (escape(f"{row['a']} - {row['b']}"), number(scaled(row["area_m2"], 1e4)), number(row["normal_force_n"]),
         number(row["tangential_force_n"]), number(scaled(row["max_penetration_m"], 1e3)),
         number(scaled(row["max_gap_m"], 1e3)))
        for row in rows if isinstance(row, Mapping)
    ]  # fmt: skip
    head = ("between", "area [cm2]", "normal [N]", "tangential [N]", "penetration [mm]", "gap [mm]")
    return table(head, cells, range(1, 6))


def scaled(value: JsonValue, factor: float) -> JsonValue:
    """A number in another unit; other values are unchanged."""
    return value * factor if isinstance(value, (int, float)) else value


def materials(rows: JsonValue) -> str:
    """Material of every part, and the reason for it."""
    if not isinstance(rows, list) or not rows:
        return "<p>No stage got as far as materials.</p>"
    cells = [
        (escape(f"{row['body']} {row['part']}"), escape(str(row["material"])), escape(str(row["model"])),
         number(row["density"]), number(row["youngs_modulus"]), number(row["poisson_ratio"]),
         escape(str(row["reason"])))
        for row in rows if isinstance(row, Mapping)
    ]  # fmt: skip
    return table(("part", "material", "model", "kg/m3", "E [Pa]", "nu", "why"), cells, (3, 4, 5))


def bullets(lines: Sequence[object], nothing: str) -> str:
    """A list, or `nothing` if it is empty."""
    if not lines:
        return f"<p>{nothing}</p>"
    return "<ul>" + "".join(f"<li>{escape(str(line))}</li>" for line in lines) + "</ul>"


def messages(tree: Mapping[str, JsonValue], key: str) -> str:
    """The `warnings` or the `notes`, which files of earlier versions lack."""
    rows = tree.get(key)
    return bullets(rows if isinstance(rows, list) else [], "None.")


def rotation_words(rotation: Rotation) -> str:
    """The chosen rotation with its reason, and how it was decided without pictures."""
    if rotation.pictures:
        seen = "A model saw the object turned half about x, y and z:"
    elif rotation.reason == POSE_OF_THE_FILE:
        seen = "No rotation was chosen, and no pictures were used."
    else:
        seen = "Offline no pictures are used: rules on the words of the sentence and the shape decided."
    return f"<p>Chosen: <b>{escape(rotation.candidate)}</b>. {escape(rotation.reason)}</p><p>{seen}</p>"


def heat_legend(span: float) -> str:
    """Colour bar of the dent."""
    ends = f"<span>-{span * 1e3:.3g} mm (in)</span><span>0</span><span>+{span * 1e3:.3g} mm (out)</span>"
    bar = f"linear-gradient(to right, {css(DEEP)}, {css(LEVEL)}, {css(RAISED)})"
    return page(
        f'<div class="bar" style="background: {bar}"></div><div class="ends">{ends}</div>'
        "displacement along the outward normal"
    )


def cloud_legend(clouds: Sequence[MaterialCloud]) -> str:
    """Legend of the materials' colours."""
    rows = {
        f'<div><span class="dot" style="background: {css(one.color)}"></span>{escape(one.material)}</div>': None
        for one in clouds
    }
    return page("".join(rows), "<div>material points before the drop</div>")
