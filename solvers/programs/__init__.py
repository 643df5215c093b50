"""Parts shared by the solvers of programs: attempts, scaling, and adapters of libraries."""

#: Report of :meth:`.Program.describe`.
DESCRIPTIONS = {"program": ".description:describe"}
