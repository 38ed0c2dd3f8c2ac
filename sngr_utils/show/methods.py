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
    source : who proposed it
    width : of its line, [pt]
    """

    name: str
    colour: str
    dash: str
    marker: str | None
    source: str
    width: float = 0.9


METHODS = {
    "dead_reckoning": Method("dead reckoning", BLACK, ":", None, "odometry alone, no ranges"),
    "isam2": Method("iSAM2", BLUE, "--", "o", "Kaess et al., IJRR 2012"),
    "sngr": Method("SNGR", VERMILLION, "-", "x", "the paper"),
    "online": Method("association-aware SNGR", GREEN, "-", None, "ours", 2.4),
    "least_squares": Method("least squares", ORANGE, "-", "s", "the loss of iSAM2, in batch"),
    "huber": Method("Huber", PURPLE, "-", "D", "Huber 1964"),
    "cauchy": Method("Cauchy", BLUE, "-", "v", "Holland & Welsch 1977"),
    "dcs": Method("DCS", ORANGE, "--", "^", "Agarwal et al., ICRA 2013"),
    "geman_mcclure": Method("Geman-McClure", VERMILLION, "--", ">", "Geman & McClure 1985"),
    "gnc_tls": Method("GNC-TLS", GREY, "-", "P", "Yang et al., RA-L 2020"),
    "gnc_gm": Method("GNC-GM", GREY, "--", "<", "Yang et al., RA-L 2020"),
    "switchable": Method("switchable", SKY, "-.", "d", "Suenderhauf & Protzel, IROS 2012"),
    "max_mixture_null": Method("max-mixture, null", PURPLE, ":", "p", "Olson & Agarwal, IJRR 2013"),
    "max_mixture_all": Method("max-mixture, all", PURPLE, "--", "v", "Olson & Agarwal, IJRR 2013"),
    "fastslam": Method("FastSLAM", SKY, "-", "^", "Montemerlo et al., AAAI 2002"),
    "em": Method("EM", SKY, "--", "+", "Bowman et al., ICRA 2017"),
    "em_exclusive": Method("EM, exclusive", BLACK, "--", None, "Bar-Shalom & Fortmann 1988", 1.4),
    "oracle": Method("oracle", BLACK, "-", None, "told which landmark a range came from"),
}


def shown(key: str) -> str:
    """What a method is called, or anything else that has underscores for spaces."""
    return METHODS[key].name if key in METHODS else key.replace("_", " ")
