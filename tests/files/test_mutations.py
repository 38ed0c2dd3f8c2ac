"""Files that somebody spoiled at random are read, or refused in one line that names the file."""

import random
import re

import pytest

from sngr_utils.files import formats

TABLES = {
    "odometry": "time_s,dx_m,dy_m,dtheta_rad,sigma_x_m,sigma_y_m,sigma_theta_rad,rho_xy\n"
    "0,0,0,0,.1,.1,.05,\n1,1,0,0,.1,.1,.05,.2\n2,1,0,0,.1,.1,.05,0\n",
    "ranges": "pose,range_m,sigma_m,landmark,source,p:a,p:b\n0,3,.1,a,a,.5,.5\n1,3,.1,,b,1,0\n",
    "landmarks": "landmark,x_m,y_m,sigma_m,true_x_m,true_y_m\na,1,2,.1,1,2\nb,,,,3,4\n",
    "calibration": "quantity,mean,sigma\nscale,1,.1\noffset_m,0,inf\n",
    "truth": "x_m,y_m,theta_rad\n0,0,0\n1,0,0\n2,0,0\n",
}
PYFG = """VERTEX_SE2 0 A0 0 0 0
VERTEX_SE2 1 A1 1 0 0
VERTEX_XY L0 5 6
VERTEX_SE2:PRIOR 0 A0 0 0 0 .01 0 0 .01 0 .01
VERTEX_XY:PRIOR 0 L0 5 6 .09 0 .09
EDGE_SE2 0 A0 A1 1 0 0 .04 0 0 .04 0 .01
EDGE_RANGE 0 A0 L0 7.8 .25
"""
FG = """Variable Pose SE2 X0 0 0 0
Variable Pose SE2 X1 1 0 0
Variable Landmark R2 L0 3 3
Variable Landmark R2 L1 6 3
Factor UnarySE2ApproximateGaussianPriorFactor X0 0 0 0 covariance .01 0 0 0 .01 0 0 0 .01
Factor SE2RelativeGaussianLikelihoodFactor X0 X1 1 0 0 covariance .01 0 0 0 .01 0 0 0 .01
Factor AmbiguousDataAssociationFactor Observer X1 Observed L1 L0 Weights 3 1 Binary \
SE2R2RangeGaussianLikelihoodFactor Observation 4 Sigma 1
"""
BAD = ["nan", "-inf", "-1", "0", "1e400", "1e19", "", "\t", ",", "\n", "\r", '"', "\0", "é", "A1",
       "L1", "1e-30", "9" * 400, "Weights", "covariance", "p:a", "landmark"]  # fmt: skip


def spoiled(text: str, rng: random.Random) -> str:
    """The text with some words replaced or inserted, lines lost, doubled or moved."""
    for _ in range(rng.randint(1, 3)):
        lines, at = text.split("\n"), rng.randrange(len(text))
        line = rng.randrange(len(lines))
        text = rng.choice([
            re.sub(r"[^\s,]+", lambda word: rng.choice([word[0]] * 20 + BAD), text),
            text[:at] + rng.choice(BAD) + text[at:],
            text[:at] + text[at + rng.randrange(20) :],
            "\n".join(lines[:line] + lines[line + 1 :]),
            "\n".join([*lines, lines[line]]),
            "\n".join(lines[line:] + lines[:line]),
        ]) or " "  # fmt: skip
    return text


@pytest.mark.filterwarnings("ignore::sngr_utils.world.log.LogWarning")
@pytest.mark.parametrize("kind", [*TABLES, "a.pyfg", "a.fg"])
def test_a_spoiled_file_is_read_or_refused_in_one_line(tmp_path, kind):
    rng, refused, path = random.Random(kind), [], tmp_path
    whole = {f"{name}.csv": text for name, text in TABLES.items()}
    if kind not in TABLES:
        path, whole = tmp_path / kind, {kind: PYFG if kind == "a.pyfg" else FG}
    for file, text in whole.items():
        (tmp_path / file).write_text(text)
    formats.read(path)
    spoilt = f"{kind}.csv" if kind in TABLES else kind
    for _ in range(40):
        (tmp_path / spoilt).write_text(spoiled(whole[spoilt], rng), encoding="utf-8")
        try:
            formats.read(path)
        except ValueError as error:
            refused.append(str(error))
    assert 20 < len(refused) < 40
    for said in refused:
        assert said.startswith(str(path))
        assert "\n" not in said
        assert len(said) < 500
