"""Published open-loop errors of the paper's models on the DART recordings, to compare with.

Errors at 1 s of constant velocity (CTRV), of the kinematic and of the
dynamic model: v_x, v_y [m/s] / yaw rate [rad/s] / position [m] / yaw [deg].
"""

from __future__ import annotations

from dataclasses import dataclass

MODELS = ("CTRV", "kinematic", "dynamic")


@dataclass(frozen=True, slots=True)
class Row:
    """title; parts: a recording belongs here if its path has one of them; excerpt: whether the
    excerpt in the repository holds the row whole; printed: by model, in the order of MODELS."""

    title: str
    parts: tuple[str, ...]
    windows: int
    printed: tuple[str, str, str]
    horizon: float = 1.0
    excerpt: bool = False


ROWS = (
    Row("50 tyres, Feb 24", ("50_tire",), 270, (
        ".159/.028/.295/.123/10.1", ".376/.188/.999/.535/41.2", ".187/.042/.253/.160/8.9"),
        excerpt=True),
    Row("60 lap 0.6 m/s", ("60_race",), 171, (
        ".096/.027/.282/.066/8.7", ".334/.044/.443/.187/14.3", ".321/.016/.440/.180/14.9"),
        excerpt=True),
    Row("80 circles", ("80_circles",), 904, (
        ".121/.015/.286/.094/9.5", ".874/.283/1.681/.693/60.8", ".623/.185/1.331/1.017/61.7")),
    Row("81 throttle ramps", ("81_throttle",), 1206, (
        ".109/.016/.125/.067/4.0", ".697/.356/1.943/1.493/91.0", ".452/.185/1.053/1.105/51.4")),
    Row("81 tape and tiles", ("81_circles",), 202, (
        ".086/.017/.162/.061/5.1", ".746/.292/2.144/1.126/92.9", ".463/.143/.538/.358/17.7")),
    Row("81 drifting", ("81_drifting",), 43, (
        ".364/.363/1.322/.315/45.0", "3.191/1.419/4.454/.774/155.6",
        "2.903/.423/2.639/1.990/124.8"), excerpt=True),
    Row("91 free 10_01_01", ("2024_10_01_01",), 220, (
        ".218/.063/.783/.247/25.7", ".558/.093/.865/.358/27.6", ".448/.079/.415/.290/19.4"),
        excerpt=True),
    Row("91 free 10_12_05", ("2024_10_12_05",), 174, (
        ".531/.080/3.102/1.212/98.9", ".842/.422/2.294/1.157/83.9",
        ".564/.176/1.676/1.429/76.6")),
    Row("25 Sep steering", ("25_sept",), 1006, (
        ".055/.007/.061/.033/2.7", ".807/.127/1.353/.431/42.9", ".752/.040/1.083/.415/39.8")),
    Row("27 Sep fast ramp", ("fast_ramp",), 237, (
        ".098/.018/.165/.061/5.0", ".982/.445/2.581/1.302/113.3",
        ".676/.223/1.529/1.455/72.3")),
    Row("27 Sep circle", ("circles_27_sept_2024/",), 8, (
        ".253/.050/.503/.131/14.2", ".870/.143/1.523/.496/50.7", ".793/.041/1.182/.468/49.2"),
        excerpt=True),
    Row("83 4 Apr 25", ("2025-04-04",), 63, (
        ".895/.119/3.679/1.687/124.6", ".957/.429/2.674/1.753/90.7",
        ".698/.253/1.452/1.272/52.6")),
    Row("83 24 Apr 25", ("2025-04-24",), 220, (
        ".703/.122/2.283/1.138/79.6", "1.108/.514/3.598/2.008/136.2",
        ".804/.193/.827/.736/25.7"), excerpt=True),
    Row("all", ("",), 4724, (
        ".238/.052/.924/.401/30.8", ".835/.327/1.898/1.071/76.3", ".648/.158/1.118/.907/49.8")),
    Row("all, 0.5 s", ("",), 4724, (
        ".169/.052/.662/.085/10.5", ".555/.292/1.482/.402/31.1", ".444/.141/.980/.237/20.9"), 0.5),
    Row("all, 2 s", ("",), 4724, (
        ".302/.062/1.060/1.135/78.4", "1.098/.355/2.280/1.731/186.9",
        ".808/.170/1.180/2.627/111.3"), 2.0),
    Row("transient: 60 + 91", ("60_race", "91_free"), 565, (
        ".329/.061/1.796/.691/57.4", ".611/.242/1.404/.688/50.3", ".455/.110/.995/.819/45.0")),
)


def off(found: list[float], printed: str) -> float:
    """Largest relative deviation of five figures from printed ones, beyond half a last digit."""
    worst = 0.0
    for value, text in zip(found, printed.split("/"), strict=True):
        expected = float(text)
        half = 0.5 * 10.0 ** -len(text.partition(".")[2])
        worst = max(worst, (abs(value - expected) - half) / expected)
    return worst
