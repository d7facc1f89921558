"""Carries what lies at the root of the project in the wheel: everything else stands in pyproject.toml.

Prompts, materials and datasets are at the root, where people look for them; an installed dcap has them in
`dcap/_resources` and finds them there by `dcap.scene.settings.resource`. docs/decisions/036 says why.
"""

from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

RESOURCES = ("materials.csv", "prefect.toml", "prefect.yaml", "prompts/*.j2", "data/*.yaml", "data/recipes/**/*.yaml")
"""What the program reads at run time, as patterns from the root."""
HOME = Path("dcap", "_resources")


class BuildWithResources(build_py):
    """Copies the resources beside the packages; an editable installation reads them where they are."""

    def run(self) -> None:
        """Build the packages, then add the resources."""
        super().run()
        for target, source in self.copies().items():
            self.mkpath(str(Path(target).parent))
            self.copy_file(source, target, preserve_mode=False)

    def copies(self) -> dict[str, str]:
        """Each resource by the path of its copy."""
        if self.editable_mode:
            return {}
        return {str(Path(self.build_lib) / HOME / path): path for path in resources()}

    def get_source_files(self) -> list[str]:
        """What a source distribution needs."""
        return [*super().get_source_files(), *resources()]

    def get_outputs(self, include_bytecode: bool = True) -> list[str]:
        """What the build writes."""
        return [*super().get_outputs(include_bytecode), *self.copies()]

    def get_output_mapping(self) -> dict[str, str]:
        """What the build writes, and from what."""
        return {**super().get_output_mapping(), **self.copies()}


def resources() -> list[str]:
    """Paths of the resources from the root, in order."""
    return sorted(str(path) for pattern in RESOURCES for path in Path().glob(pattern))


setup(cmdclass={"build_py": BuildWithResources})
