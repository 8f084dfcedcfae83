"""Tables, for a terminal and as Markdown; the cells of an evaluation."""

from collections.abc import Sequence

from rich.table import Table

from relight3d.evaluate.run import Evaluation

METHOD_COLUMNS = ("method", "frames", "number", "PSNR dB", "SSIM", "FLIP", "relative RMSE", "worst frame")
SURFACE_COLUMNS = ("surface", "kind", "pixels", "PSNR dB", "worst frame")
WORDS = {  # columns that are flush left
    *("method", "frames", "surface", "kind"),
    *("effect", "where", "state", "confidence", "why"),
    *("capture", "photograph", "split", "lights", "textured", "setting"),
}


def method_cells(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """A line for each method over each group of frames."""
    return [
        (
            row.method,
            row.frames,
            str(row.mean.num_frames),
            f"{row.mean.psnr_db:.2f}",
            f"{row.mean.ssim:.4f}",
            f"{row.mean.flip:.4f}",
            f"{row.mean.relative_rmse:.4f}",
            f"{row.worst.psnr_db:.2f} ({row.worst.name})",
        )
        for row in evaluation.rows()
    ]


def surface_cells(evaluation: Evaluation) -> list[tuple[str, ...]]:
    """A line for each surface, at the captured viewpoint."""
    return [
        (s.name, ", ".join(s.kinds), str(s.num_pixels), f"{s.psnr_db:.2f}", f"{s.worst_psnr_db:.2f}")
        for s in evaluation.surfaces
    ]


def terminal_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """A table for a terminal; columns of words are flush left, of numbers right."""
    table = Table(title=title, title_justify="left")
    for column in columns:
        table.add_column(column, justify="left" if column in WORDS else "right")
    for row in rows:
        table.add_row(*row)
    return table


def markdown_table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """The same as Markdown."""
    rule = ["---" if column in WORDS else "---:" for column in columns]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (columns, rule, *rows)) + "\n"
