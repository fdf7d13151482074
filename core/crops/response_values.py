"""What is asked of the response to a dose, and what a trial answers."""

from dataclasses import dataclass

from furrowmap.core.crops.response_models import ModelName
from furrowmap.core.runtime.arrays import FloatArray
from furrowmap.core.runtime.languages.texts import Text


@dataclass(frozen=True)
class ResponseQuestion:
    """What is asked of a trial.

    Attributes:
        model: the only shape to fit; None to compare all.
        ratio: price of a unit of the dose over the price of a unit of the yield; None without an economic optimum.
        unit: of the dose, for people.
    """

    model: ModelName | None = None
    ratio: float | None = None
    unit: str = ""


@dataclass(frozen=True)
class Estimate:
    """An optimum within the doses of the trial, with its 95 % interval.

    Attributes:
        low_open, high_open: the interval has no end within the doses: its end is the least or the highest dose, and
            the optimum may be there or beyond.
    """

    value: float
    low: float
    high: float
    low_open: bool = False
    high_open: bool = False


@dataclass(frozen=True)
class Gain:
    """What a dose more brings: the yield at `until` less that at `dose`, or the yield at `dose` if they are equal.

    `low` and `high` are its 95 % interval.
    """

    dose: float
    until: float
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class FittedModel:
    """A shape of the response through the observations.

    Attributes:
        weight: by AICc among the shapes; 0 where AICc does not exist or the shape is ruled out.
        aicc: second-order criterion of Akaike; None for too few observations.
        lack_of_fit_p: probability of so large a lack of fit against the pure error; None without repeated doses.
        r2: share of the variance beside the other effects that it explains.
        coefficients: in the units of dose and value.
        agronomic, economic: the dose of the highest yield or, without one, of 95 % of the rise; the one that pays.
        fitted: (m,) the curve at the doses of the response.
    """

    name: ModelName
    weight: float
    aicc: float | None
    sum_squares: float
    freedom: int
    sigma: float
    r2: float
    lack_of_fit_p: float | None
    coefficients: dict[str, float]
    agronomic: Estimate | None
    economic: Estimate | None
    fitted: FloatArray


@dataclass(frozen=True)
class Response:
    """The response of a quantity of n parcels to a dose.

    Attributes:
        lowest, highest: dose of the trial; nan without any.
        blocks: labels of the blocks; one without blocks.
        p: probability of as strong a response where the dose has no effect; None where it cannot be tested.
        p_straight: of so much curvature where the response is a straight line; None likewise.
        models: by weight; empty where no response is shown.
        agronomic, economic: averaged over the models by weight.
        best: the yield at the economic optimum, or else at the agronomic one.
        gain: what the next 10 units of dose bring from there; at the end of the doses, what the last 10 brought.
        gains: of 10 units from each dose of the trial but the highest.
        dose: (m,) abscissae of the curves, from the least dose to the highest.
        band_low, band_high: (m,) pointwise 95 % confidence band of the first model.
        expected, residual: (n,) of the first model with the other effects; nan where unknown.
        sentences: what the data show.
    """

    parcels: int
    doses: int
    lowest: float
    highest: float
    blocks: tuple[str, ...]
    p: float | None
    p_straight: float | None
    models: tuple[FittedModel, ...]
    agronomic: Estimate | None
    economic: Estimate | None
    best: Gain | None
    gain: Gain | None
    gains: tuple[Gain, ...]
    dose: FloatArray
    band_low: FloatArray
    band_high: FloatArray
    expected: FloatArray
    residual: FloatArray
    sentences: tuple[Text, ...] = ()

    @property
    def words(self) -> str:
        """What the data show."""
        return " ".join(map(str, self.sentences))
