"""A report with every kind of content."""

import numpy as np

from twin.core.findings import Finding
from twin.core.provenance import Parameter
from twin.core.units import DEG, MM
from twin.validation.result import PhaseSummary, Report, Residual

PHASES = (
    PhaseSummary("approach", "positioning", 0.0, 3.1),
    PhaseSummary("insert", "insertion", 3.1, 6.0, (0.38, 0.28, 0.145), "registered"),
    PhaseSummary("sweep", "pivot", 6.0, 8.4, (0.38, 0.28, 0.145), "enforced"),
    PhaseSummary("withdraw", "retraction", 8.4, 10.6, (0.38, 0.28, 0.145), "kept"),
    PhaseSummary("home", "home", 10.6, 12.0),
)


POINTS = ("s1", "s2", "s3", "apex1", "apex2", "apex3")


JOINTS = tuple(f"q{j}" for j in range(1, 7))


def motion(rate: int = 1000) -> dict[str, np.ndarray]:
    """Return joint and tool curves at `rate` in Hz; each phase is a quintic from rest to rest."""
    t = np.arange(int(12 * rate) + 1) / rate
    rng = np.random.default_rng(7)
    home = np.array([262.5, 474.8, 134.0, -54.8, 295.3, 525.3]) * MM
    stops = [home, *(home + rng.uniform(-60, 60, (4, 6)) * MM), home]
    pose = np.array([[407.9, 306, 211.4, 10, 15, 10], [380, 280, 185, 0, 0, 0], [380, 280, 145, 0, 0, 0]])
    pose = np.vstack([pose, [365.2, 283.2, 148.0, 15, 20, 10], [372.0, 281.5, 168.0, 15, 20, 10], pose[0]])
    pose = pose * np.array([MM] * 3 + [DEG] * 3)

    def along(stops):
        out = [np.zeros((len(t), 6)) for _ in range(3)]
        for i, phase in enumerate(PHASES):
            T = phase.t1 - phase.t0
            on = (t >= phase.t0) & (t <= phase.t1)
            s = (t[on] - phase.t0) / T
            step = np.asarray(stops[i + 1]) - stops[i]
            out[0][on] = stops[i] + np.outer(10 * s**3 - 15 * s**4 + 6 * s**5, step)
            out[1][on] = np.outer(30 * s**2 - 60 * s**3 + 30 * s**4, step) / T
            out[2][on] = np.outer(60 * s - 180 * s**2 + 120 * s**3, step) / T**2
        return out

    q, qd, qdd = along(stops)
    p, v, a = along(pose)
    return {
        "t": t, "q": q, "qd": qd, "qdd": qdd, "p_tool": p[:, :3], "v_tool": v[:, :3], "a_tool": a[:, :3],
        "angles": p[:, 3:],
    }  # fmt: skip


def make_report(kind: str = "agree", rate: int = 1000) -> Report:
    rng = np.random.default_rng(3)
    series = motion(rate)
    t = series["t"]
    n, wrong = len(t), kind == "disagree"
    bump = np.exp(-(((t - 7.21) / 0.9) ** 2))
    inside = (t >= 3.1) & (t <= 10.6)
    noise = lambda k, size: np.abs(rng.normal(0, size, k)) + size / 5  # noqa: E731
    series |= {
        "residual_tool": noise(n, 9e-14) + wrong * 0.71e-3 * bump,
        "residual_rotation": noise(n, 4e-13) + wrong * 0.4 * DEG * bump,
        "rcm_error": np.where(inside, noise(n, 6e-14), np.nan),
        "fulcrum": np.where(inside[:, None], np.c_[np.sin(t), -1.2 * np.sin(t)] * 20 * MM, np.nan),
        "limit_margin": 35e-3 + 18e-3 * np.cos(t / 2.1),
        "clearance_t": t[::10],
        "clearance": (9.5 + 4 * np.cos(t[::10] * 0.8 + 1)) * MM,
        "t_coarse": t[::10],
    }
    c = series["t_coarse"]
    for key in ("p_tool", "v_tool", "a_tool"):
        series[f"{key}_B"] = series[key][::10]
    for i in range(1, 4):
        series[f"reach.limb {i}"] = (90 + 40 * np.sin(t / 3 + i)) * MM
    series["singularity.type2"] = -0.55 + 0.2 * np.sin(t / 2)
    for i in range(9):
        name = ("bar_across", "bar_along", "ball_on_rail")[i // 3]
        series[f"singularity.{name}_{i % 3 + 1}"] = 0.3 + 0.05 * i + 0.1 * np.sin(t / 2 + i)
    for name in POINTS:
        off = {"s1": 1.27e-3, "s3": 1.06e-3}.get(name, 0.0)
        series[f"residual_point.{name}"] = noise(len(c), 8e-14) + wrong * off * bump[::10]
    for i, name in enumerate(JOINTS):
        off = 1.9e-3 if i in (0, 1, 4, 5) else 0.0
        series[f"residual_driven.{name}"] = noise(len(c), 1e-13) + wrong * off * bump[::10] * (0.6 + 0.1 * i)
    rows: list[Residual] = []

    def row(pair, quantity, name, unit, values, tolerance, **more):
        k = int(np.nanargmax(values))
        at = float(c[k] if len(values) == len(c) else t[k])
        phase = next((p.name for p in PHASES if p.t0 <= at <= p.t1), "")
        rms = float(np.sqrt(np.nanmean(values**2)))
        rows.append(
            Residual(
                pair, quantity, name, unit, float(values[k]), rms, tolerance, at, phase,
                "xyz"[k % 3], len(values), **more,
            )
        )  # fmt: skip

    because = "point s1" if wrong else ""
    for name in POINTS:
        row("A-B", "point", name, "m", series[f"residual_point.{name}"], 1e-6)
    for key, quantity, name, unit, tol in (
        ("residual_tool", "tool", "tool", "m", 1e-6),
        ("residual_rotation", "tool", "tool", "rad", 1e-4 * DEG),
    ):
        row("A-B", quantity, name, unit, series[key], tol, consequence_of=because)
    for i, name in enumerate(JOINTS):
        off = wrong and i in (0, 1, 4, 5)
        row(
            "A-B",
            "driven",
            name,
            "m",
            series[f"residual_driven.{name}"],
            1e-6,
            consequence_of=because if off else "",
        )
    for name in ("rf1", "rf2", "rf3", "r11", "r12", "r13"):
        row("A-B", "passive", name, "rad", noise(len(c), 3e-13), 1e-4 * DEG)
    row("A-B", "speed", "q1", "m/s", noise(len(c), 3e-11), 1e-6)
    row(
        "A-B",
        "acceleration",
        "q1",
        "m/s2",
        noise(len(c), 4e-8),
        1e-4,
        note="from differences of the mechanism",
    )
    for i in (1, 2, 3):
        row("B", "loop", f"limb{i}", "m", noise(n, 5e-14), 1e-9)
    row("B", "rcm", "rcm", "m", np.nan_to_num(series["rcm_error"]), 1e-4)
    row("B-C", "tool", "tool", "m", noise(len(c), 9e-9), 1e-6, note="joint frames of the stage are float32")
    row("B-C", "tool", "tool", "rad", noise(len(c), 4e-8), 1e-4 * DEG)
    for name in POINTS[:3]:
        row("B-C", "point", name, "m", noise(len(c), 8e-9), 1e-6)
    row("B-D", "baked", "tool", "m", noise(len(c), 3e-6), 1e-4)
    row("B-D", "baked", "tool", "rad", noise(len(c), 2e-5), None, note="between keys, 60 Hz")
    return Report(
        robot="sils",
        title="SILS 6-DOF parallel robot, three limbs R-PRR-PRS",
        source="Ro. J. Techn. Sci. - Appl. Mech. 68(1), 3-18, 2023, DOI 10.59277/RJTS-AM.2023.1.01",
        protocol="table2",
        protocol_title="SILS insertion protocol with the RCM kept",
        variants={"eq1": "printed" if wrong else "corrected", "eq2": "corrected"},
        reasons={
            "eq1": "X and Y of S1 and S3: last factor c_theta -> c_phi. Only then is S_i = E + R a_i with constant "
            "a_i; all three sides are then l_p at every pose.",
            "eq2": "Radicals repaired; in the odd rows (l_1 + l_2) -> (l_2 - l_1). Only then is the strut l_1 long.",
        },
        residuals=tuple(rows),
        findings=_findings(kind),
        phases=PHASES,
        parameters=(
            *(
                Parameter(name, mm * MM, "mm", mm, "PUBLISHED", "RJTS-AM 68(1), 2023, eq. (3)")
                for name, mm in (("l_0", 50.0), ("l_1", 182.0), ("l_2", 392.0), ("l_p", 135.0), ("L_V", 657.0))
            ),
            Parameter("L_H", 0.612, "mm", 612.0, "ASSUMED", "eq. (3) values L_B, eq. (2) uses L_H: taken as one"),
            Parameter("joint.q1.max_speed", 0.1, "mm/s", 100.0, "ASSUMED", "no published speed; a common ball screw"),
            Parameter("steel.density", 7850.0, "kg/m3", 7850.0, "CITED", "EN 10025"),
            Parameter("t_prime.x", 0.365188, "mm", 365.188, "DERIVED", "from the RCM and the depth of I"),
        ),
        facts={
            "Mechanism": {"mobility": "6 (18 links, 21 joints, 3 loops)", "mass": "4.82 kg", "bodies": "16"},
            "Sampling": {"judged at": "1000 Hz", "independent model at": "100 Hz", "baked at": "60 Hz"},
            "Sensitivity": {"0.1 mm longer bar 1": "0.083 mm at s1", "float32 joint frames": "28 nm at the tool"},
        },
        environment={"twin": "0.1.0", "python": "3.12.3", "casadi": "3.8.0", "pin": "4.1.0", "machine": "Linux x86_64"},
        joint_names=JOINTS,
        series=series,
    )  # fmt: skip


def _findings(kind: str) -> tuple[Finding, ...]:
    rcm, sweep = "RCM at (380.00, 280.00, 145.00) mm", "phase 'sweep', t = 7.2 s"
    measure, near = "margin.singularity", "the singularity measure {} falls to {}; alarm {}".format
    names = [f"{n}_{i}" for n in ("bar_across", "bar_along", "ball_on_rail") for i in (1, 2, 3)]
    soft = "joint q4 reaches -58.20 mm, 3.20 mm beyond its soft limits -55.00..600.00 mm"
    kept = "the shaft passes the RCM at up to 2.1e-10 mm; 0.1 mm is allowed"
    limit = "the joint closest to a hard limit is q4, 17.00 mm away"
    out = [
        Finding("rcm.kept", "info", kept, rcm, sweep, 2.1e-10, "mm", 0.1),
        Finding("margin.limit", "info", limit, "q4", "t = 6.6 s", 17.0, "mm", 0.0),
        Finding(measure, "info", near("type2", 0.35, 0.15), "type2", "t = 3.1 s", 0.35, "", 0.15),
        *(Finding(measure, "info", near(n, 0.3, 0.1), n, "t = 9 s", 0.3, "", 0.1) for n in names),
        Finding("limit.soft", "warning", soft, "q4", sweep, 3.2, "mm", 0.0, "move the trocar 4 mm towards the portal"),
    ]
    if kind == "disagree":
        apart = "formula and mechanism put s1 1.27 mm apart; 1 um is allowed"
        missed = "the shaft passes the RCM at up to 0.13 mm; 0.1 mm is allowed"
        edit = "eq1 row X_S1: replace c_theta by c_phi in the last term (twin explain sils --variant eq1=printed)"
        when = "phase 'sweep', t = 7.21 s (psi 10.2, theta 13.1, phi 6.4 deg)"
        out += [
            Finding("point.differs", "disagreement", apart, "s1", when, 1.27, "mm", 0.001, edit, "eq1 (printed)"),
            Finding("rcm.missed", "disagreement", missed, rcm, sweep, 0.13, "mm", 0.1),
        ]
    if kind == "unchecked":
        text = "cylinder of radius 8 mm near (0, 0, 0) not found on limb1"
        out_of = "check near_mm, or redraw the STEP with cad/sils/model.py"
        out.append(Finding("cad.missing", "error", text, "limb1.shaft", "cad/sils/sils.toml:53", suggestion=out_of))
    return tuple(out)
