"""How every method is called and drawn, in all notebooks and the paper: one table."""

from dataclasses import dataclass

from sngr_utils.show import style

SKY, GREEN, ORANGE, VERMILLION, PURPLE, GREY = style.SEQUENCE
BLUE, BLACK = style.ESTIMATE, style.TRUTH


@dataclass(frozen=True)
class Method:
    """A method's name, and its look in every figure.

    Attributes
    ----------
    dash, marker : of matplotlib; no marker if None
    width : of its line, [pt]
    """

    name: str
    colour: str
    dash: str
    marker: str | None
    width: float = 0.9


METHODS = {
    "dead_reckoning": Method("dead reckoning", BLACK, ":", None),
    "isam2": Method("iSAM2", BLUE, "--", "o"),
    "sngr": Method("SNGR", VERMILLION, "-", "x"),
    "online": Method("association-aware, online", GREEN, "-", None, 2.4),
    "least_squares": Method("least squares", ORANGE, "-", "s"),
    "huber": Method("Huber", PURPLE, "-", "D"),
    "cauchy": Method("Cauchy", BLUE, "-", "v"),
    "dcs": Method("DCS", ORANGE, "--", "^"),
    "geman_mcclure": Method("Geman-McClure", VERMILLION, "--", ">"),
    "gnc_tls": Method("GNC-TLS", GREY, "-", "P"),
    "gnc_gm": Method("GNC-GM", GREY, "--", "<"),
    "switchable": Method("switchable", SKY, "-.", "d"),
    "max_mixture_null": Method("max-mixture, null", PURPLE, ":", "p"),
    "max_mixture_all": Method("max-mixture, all", PURPLE, "--", "v"),
    "fastslam": Method("FastSLAM", SKY, "-", "^"),
    "em": Method("EM", SKY, "--", "+"),
    "em_exclusive": Method("EM, exclusive", BLACK, "--", None, 1.4),
    "oracle": Method("oracle", BLACK, "-", None),
}

PRINTED = Method("printed", style.PRINTED, "--", "s", 0.8)  # what the paper prints, in any figure


def shown(key: str) -> str:
    """What a method is called, or anything else that has underscores for spaces."""
    return METHODS[key].name if key in METHODS else key.replace("_", " ")
