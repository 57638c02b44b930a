# Everything a fresh machine needs comes from pinned packages: the virtual environment from uv.lock, the C
# compiler from pip's ziglang. Debian's python3, git and make are all that must be there.
PYTHON ?= python3
UV := uv==0.13.9
BIN := .venv/bin

.PHONY: demo test lint bench clean

demo: .venv/ready
	$(BIN)/canine run three_waypoint --seed 1 --out out/demo

test: .venv/ready
	@command -v gcc >/dev/null || { [ "$$(id -u)" = 0 ] && apt-get update -qq && apt-get install -y -qq gcc; } || true
	$(BIN)/python -m pytest -n auto

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/ready
	$(BIN)/python -m tests.bench

clean:
	rm -rf .venv out fmus/build

.venv/ready: uv.lock pyproject.toml
	$(PYTHON) -m venv .venv || { echo "A virtual environment could not be made; on Debian: apt install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(UV)
	$(BIN)/uv sync --frozen --inexact --quiet
	touch $@
