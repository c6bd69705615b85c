"""Words by which a table's time column, group column and units row are known.

Chinese, Dutch, English, French, German, Italian, Spanish. What the other columns mean is decided in
`meaning`.
"""

import re
import unicodedata

NS_PER_UNIT = {
    "ns": 1,
    "us": 1_000,
    "ms": 1_000_000,
    "s": 1_000_000_000,
    "min": 60_000_000_000,
    "h": 3_600_000_000_000,
}

_UNIT_WORDS = {
    "ns": "ns nsec nanos nanosecond nanoseconds nanosekunden 纳秒",
    "us": "us µs μs usec micros microsecond microseconds mikrosekunden 微秒",
    "ms": "ms msec millis millisecond milliseconds millisekunden 毫秒",
    "s": "s sec secs second seconds sek sekunde sekunden seconde secondes secondi seconden 秒",
    "min": "min mins minute minutes minuten 分 分钟",
    "h": "h hr hrs hour hours stunde stunden 小时",
}
_UNIT = {_word: unit for unit, words in _UNIT_WORDS.items() for _word in words.split()}

# Names in the order in which they are preferred; compared without case, spaces, "_", "-", ".".
_TIME = (
    "time timestamp zeit zeitstempel 时间 时间戳 datetime dateandtime datetimestamp datumzeit "
    "datumuhrzeit datumundzeit 日期时间 elapsed elapsedtime reltime relativetime timerel "
    "timeelapsed timesincestart logtime logtimestamp recordtime recordingtime systemtime systime "
    "sampletime samplingtime timeutc utctime utc utctimestamp timestamputc localtime timelocal "
    "unixtime unixtimestamp epoch epochtime posixtime ts tstamp stamp clock uptime "
    "messzeit messzeitpunkt aufzeichnungszeit relativzeit laufzeit uhrzeit zeitpunkt systemzeit "
    "temps tempo tijd tijdstempel tijdstip tiempo horodatage "
    "采样时间 测量时间 记录时间 采集时间 相对时间 系统时间 运行时间 时刻 gpstime utcgpstime gpsutc "
    "gpstimestamp timeaxis zeitachse millis micros milliseconds microseconds seconds sekunden "
    "timestamps xvalue t excel exceltime exceldate matlabtime datenum serialdate"
).split()
_DATE = (
    "date datum fecha 日期 day tag recorddate logdate messdatum localdate utcdate 测量日期".split()
)
_CLOCK = (
    "time uhrzeit zeit heure ora hora tijd tijdstip 时间 timeofday clock localtime utctime utc 时刻"
).split()
_GROUP = (
    "axle axleid axleno axlenr axlenumber axleindex axlenum wheelset wheelsetid wheelsetno wheel "
    "wheelid device deviceid deviceno unit unitid vehicle vehicleid car carid carno bogie bogieid "
    "train trainid sensor sensorid node nodeid source id "
    "achse achsnr achsnummer achsid radsatz radsatznr rad gerät gerätenr geräteid fahrzeug "
    "fahrzeugid fahrzeugnr wagen wagennr drehgestell "
    "essieu asse eje wielstel "
    "轴 轴号 轴位 车轴 车轴号 轮对 轮对号 设备 设备号 设备id 车号 车厢 车厢号 转向架"
).split()
_SIGNAL = (
    "signal signalname signalid channel channelname channelid variable variablename parameter "
    "parametername param tag tagname quantity measurement measurand name topic "
    "kanal kanalname messgröße messgroesse größe messkanal variablenname bezeichnung messstelle "
    "信号 信号名 信号名称 通道 通道名 通道名称 变量 变量名 参数 名称 测点"
).split()
_UNITS_NAME = (
    "unit units einheit einheiten unité unités unità eenheid unidad yunitlabel unitstring 单位"
).split()
_COUNTER = "index idx i n no nr number row rownumber sample samples samplenumber count counter seq sequence record frame line id zeile lfdnr nummer 序号 编号 行号".split()  # noqa: E501

_UNITS_ROW = frozenset(
    "s sec ms msec us μs ns min h d bar mbar kpa mpa pa hpa psi km/h kmh kph m/s mph rpm 1/min "
    "tr/min giri/min omw/min km/u "
    "u/min min-1 min^-1 rad/s 1/s hz khz kn n nm v mv a ma w kw % ‰ ° deg rad °c c degc k m mm cm "
    "km g kg t l m/s2 m/s² m/s^2 1 - -- bool enum text string utc iso counts imp pulses "
    "秒 毫秒 千帕 兆帕 帕 巴 公里/小时 千米/小时 米/秒 转/分 牛 千牛 无".split()
)


def normal(text: str) -> str:
    """The text as it is compared: compatibility forms folded, no case, no separators."""
    return re.sub(r"[\s_.\-]+", "", unicodedata.normalize("NFKC", text).casefold())


def time_unit(text: str) -> str | None:
    """Unit a units cell states ("[ms]", "(s)", "秒"), as a key of `NS_PER_UNIT`."""
    return _UNIT.get(normal(text).strip("[](){}<>"))


def time_name(header: str) -> tuple[int, str | None] | None:
    """Rank (lower is likelier) and stated unit of a header that names time, None of another.

    "t [ms]", "time_ms", "Zeit (s)", "时间(s)", "Time/s", "timeMs", "elapsed_seconds".
    """
    text = unicodedata.normalize("NFKC", header).strip()
    if len(text) > 80:
        return None
    unit = None
    for pattern in (
        r"^(.*?)\s*[\[(<{]\s*([^\])>}]*)\s*[\])>}]$",
        r"^(.*?)\s*(?:/|,|\bin\b)\s*(\w+)$",
        r"^(.*?)[ _\-.](\w+)$",
        r"^(.*?[a-z])(Ns|Us|Ms|S|Sec)$",
    ):
        if (found := re.match(pattern, text)) and (stated := time_unit(found[2])):
            text, unit = found[1], stated
            break
    else:  # "Time [hh:mm:ss.fff]", "Timestamp (UTC)"
        text = re.sub(r"\s*[\[(](?:UTC|GMT|local|ISO ?8601|[a-zA-Z]{1,4}[-/:.]\S+)[\])]$", "", text)
    name = normal(text)
    plain = name.rstrip("0123456789")
    if len(plain) > 2 or unit:  # "time2", "t2 [s]"; T1 and T2 alone are temperatures
        name = plain or name
    if name not in _TIME:
        return None
    return _TIME.index(name), unit or _UNIT.get(name if name not in ("t", "h", "s") else "")


def speaks_of_time(header: str) -> bool:
    """Whether a word of a header that need not name time does: "t_p", "Time pressure [s]"."""
    words = re.findall(r"[^\W\d_]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", header).casefold())
    return any(word in _TIME for word in words)


def is_date_name(header: str) -> bool:
    """Whether a header names the date half of a date and time pair."""
    return normal(header) in _DATE


def is_clock_name(header: str) -> bool:
    """Whether a header names the time-of-day half of a date and time pair."""
    return normal(header) in _CLOCK


def is_group_name(header: str) -> bool:
    """Whether a header names a device or an axle, as long tables have."""
    return normal(header) in _GROUP


def is_signal_name(header: str) -> bool:
    """Whether a header says that the cells below name what another column holds."""
    return normal(header) in _SIGNAL


def is_units_name(header: str) -> bool:
    """Whether a header says that the cells below are units."""
    return normal(header) in _UNITS_NAME


def is_counter_name(header: str) -> bool:
    """Whether a header names a row counter, which rises like a time and is none."""
    return normal(header) in _COUNTER


def is_units_row(cells: list[str]) -> bool:
    """Whether the cells of a row are units: all of them, or most and the others short.

    Letters that are names as well (t, v, p, a) count only where every cell is a unit.
    """
    said = [unicodedata.normalize("NFKC", c).casefold().replace(" ", "") for c in cells if c]
    known = [
        c in _UNITS_ROW
        or re.fullmatch(r"[\[({<][^\])}>]{0,16}[\])}>]|[hmsdyf.:/-]{4,}", c) is not None
        for c in said
    ]
    if not any(c not in ("-", "--") for c in said):
        return False
    sure = sum(k and (len(c) > 1 or c in "s%°-") for k, c in zip(known, said, strict=True))
    short = all(k or len(c) <= 10 for k, c in zip(known, said, strict=True))
    return all(known) or (short and sure >= 2 / 3 * len(said))
