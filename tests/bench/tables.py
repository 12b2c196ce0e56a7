"""Tables in Markdown whose columns also line up as plain text."""
import math


def table(header, rows):
    """header: titles, those of numbers end in ':'; rows: lists of texts."""
    right = [title.endswith(":") for title in header]
    cells = [[title.rstrip(":") for title in header], *rows]
    widths = [max(3, *(len(row[i]) for row in cells)) for i in range(len(header))]

    def line(row):
        return "| " + " | ".join(text.rjust(width) if is_right else text.ljust(width)
                                 for text, width, is_right in zip(row, widths, right)) + " |"

    rule = "|" + "|".join("-" * (width + 1) + (":" if is_right else "-") for width, is_right in zip(widths, right)) + "|"
    return "\n".join([line(cells[0]), rule, *(line(row) for row in cells[1:])]) + "\n"


def ms(value):
    """Three digits that count."""
    if value >= 100:
        return f"{value:.0f}"
    return f"{value:.1f}" if value >= 10 else f"{value:.2f}"


def cell(answer, key="total_ms"):
    return answer["failed"] if "failed" in answer else ms(answer[key])


def memory(answer):
    """Peak of the process, and how much of it came on top of program and input."""
    if "failed" in answer:
        return f"{answer['peak_kb'] / 1024:.0f} when ended"
    return f"{answer['peak_kb'] / 1024:.0f} ({answer['on_top_kb'] / 1024:.1f})"


def times(ratio):
    return f"{ratio:.2f}" if ratio < 10 else f"{ratio:.1f}"


def geometric_mean(values):
    values = list(values)
    return math.exp(sum(math.log(value) for value in values) / len(values)) if values else math.nan
