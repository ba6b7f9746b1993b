"""The data dictionary as a page, rendered from the contracts themselves."""

from s3le.guard.table import guard, motions
from s3le.human.tables import MOCAP_DOMAIN, MOCAP_POINTS, SKELETONS
from s3le.learn.table import index
from s3le.retarget.clips import retarget
from s3le.retarget.settings import Settings
from s3le.retarget.table import stored_poses
from s3le.robot.table import ROBOT_PAIRS
from s3le.store.schema import Table
from s3le.study.tables import SYNTHETIC, ground_truth, retargeted
from s3le.tuples.tables import kinematic_pairs, mocap_pairs, robot_poses


def tables(n_dof: int, margin: float, latent: int) -> list[Table]:
    """Every table, in the order in which the stages write them.

    Args:
        n_dof: moving joints of the robot.
        margin: clearance that feasible poses keep [m].
        latent: dimension of Z.
    """
    return [
        ROBOT_PAIRS,
        MOCAP_POINTS,
        SKELETONS,
        MOCAP_DOMAIN,
        mocap_pairs(n_dof, margin),
        kinematic_pairs(n_dof, margin),
        robot_poses(n_dof, margin),
        ground_truth(n_dof, margin),
        index(n_dof, margin, latent),
        retargeted(n_dof),
        SYNTHETIC,
        stored_poses(n_dof, margin),
        guard(margin),
        motions(n_dof, margin),
        retarget(Settings().between),
    ]


def page(shown: list[Table]) -> str:
    """Markdown: for each table its grain, key, columns with units, and the names of its rules."""
    parts = [
        "# Tables\n\nRendered from `s3le/tables`; widths are those of COMAN with the default "
        "parameters. A rule is checked when a table is written and again when it is read; NaN "
        "and null fail every rule."
    ]
    for table in shown:
        rows = "\n".join(
            f"| `{name}` | {column.dtype} | {column.unit} | {column.doc} |"
            for name, column in table.columns.items()
        )
        rules = ", ".join(rule.replace("_", " ") for rule in table.rules)
        parts.append(
            f"## {table.name}\n\n{table.grain[0].upper()}{table.grain[1:]}. Written by stage "
            f"`{table.stage}`, key `{', '.join(table.key)}`"
            + (", made for one robot" if table.robot else "")
            + f". Rules: {rules}.\n\n| column | type | unit | what |\n|---|---|---|---|\n{rows}"
        )
    return "\n\n".join(parts) + "\n"
