from gip_localizer.core.confidence import Term

OFFSET = 0.0
TERMS: tuple[Term, ...] = ()
