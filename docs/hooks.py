"""MkDocs hooks: pages that are kept beside the code (READMEs), links between all pages, files that
pages show, and a game that is played on the first page.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

from marl_cair.cli.viewing.browser_play import write_game
from marl_cair.games import GAMES
from marl_cair.games.compiled import cache_root
from marl_cair.npm import Package, install_package

ROOT = Path(__file__).resolve().parents[1]
README_GAMES = sorted(path.parent.name for path in ROOT.glob("marl_cair/games/*/README.md"))
# Path in the repository -> path in the site.
PAGES = {
    "README.md": "index.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
    "agents/README.md": "agents.md",
    "examples/README.md": "examples.md",
    **{f"marl_cair/games/{game}/README.md": f"games/{game}.md" for game in README_GAMES},
}
PLAYED, FRAME_AFTER = "deep_line_wars", "images/deep_line_wars.gif)\n"
FRAME = """
Play it here, against the [trained agent](agents.md) ([how this works](browser.md)):

<iframe id="game" src="game/index.html" title="Play" loading="lazy"
  style="width: 100%; height: 50rem; border: 0"></iframe>
<script>
addEventListener("message", ({ source, data }) => {
  const frame = document.getElementById("game");
  if (source === frame.contentWindow && data.height > 0) frame.style.height = data.height + "px";
});
</script>
"""
# What search needs in pages from disk; the plugin `offline` would load it from unpkg.com.
SEARCH = Package(
    name="iframe-worker",
    version="1.0.4",
    sha512="roeaaI+Lg1LJNfgpCjoRe/+WzEjy9+Z08LoEvu85MCPbBjwm+qXz8Ag5U05lHa6V1CysZyGzE0SOkAtSUA5q7Q==",
    files=("LICENSE", "shim/index.js"),
)
# A file that the site shows in place of the comment; a link to it stands before.
SHOWN = re.compile(r"<!-- show (\S+) -->")
# A picture's or link's target; code in backticks is left alone.
LINK = re.compile(r"(?<=\]\()(?!\w+:|#)([^)\s#]+)(#[^)\s]*)?(?=\))")


def install_search() -> Path:
    """The folder of the script of search, fetched once. Raises InstallError."""
    return install_package(SEARCH, cache_root() / f"{SEARCH.name}-{SEARCH.version}")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that lie outside docs/, and the script of search."""
    script = (install_search() / "index.js").read_text("utf-8")
    files.append(File.generated(config, "iframe-worker.js", content=script))
    for source, target in PAGES.items():
        text = (ROOT / source).read_text("utf-8")
        files.append(File.generated(config, target, content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Point links at pages of the site, or at the repository if there is no page; show files."""
    here = page.file.src_uri
    sources = {target: source for source, target in PAGES.items()}
    folder = posixpath.dirname(sources.get(here, f"docs/{here}"))

    def relink(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(folder, match[1]))
        anchor = match[2] or ""
        target = PAGES.get(path) or path.removeprefix("docs/")
        file = files.get_file_from_path(target) if path.startswith("docs/") else None
        if path in PAGES or (file is not None and file.inclusion.is_included()):
            return posixpath.relpath(target, posixpath.dirname(here) or ".") + anchor
        kind = "tree" if (ROOT / path).is_dir() else "blob"
        return f"{config.extra['social'][0]['link']}/{kind}/main/{path}{anchor}"

    linked = LINK.sub(relink, markdown)
    linked = SHOWN.sub(
        lambda match: f"```python\n{(ROOT / match[1]).read_text('utf-8')}```", linked
    )
    if here != "index.md":
        return linked
    before, found, after = linked.partition(FRAME_AFTER)
    if not found:
        raise ValueError(f"README.md holds no {FRAME_AFTER!r}, below which the game is shown")
    return before + found + FRAME + after


def on_post_build(config: Any) -> None:
    """Write the game of the first page; compiling its rules takes a minute, once."""
    write_game(Path(config.site_dir) / "game", GAMES[PLAYED], None, (), None)
