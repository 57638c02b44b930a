# Everything a fresh machine needs comes from pinned packages: the virtual environment from uv.lock, the C
# compiler from pip's ziglang. Debian's python3, git and make are all that must be there.
PYTHON ?= python3
UV := uv==0.13.9
BIN := .venv/bin

.PHONY: demo test coverage tools pil lint bench mutants clean

demo: .venv/ready
	$(BIN)/canine run three_waypoint --seed 1 --out out/demo
	@echo "Lead the dog yourself, in the browser: $(BIN)/canine station --simulate three_waypoint"

# Tools of the tests that are not Python packages: root installs them; a test without its tool skips and says so.
TOOLS := gcc:gcc nm:binutils clang:clang clang:libclang-rt-dev cppcheck:cppcheck \
         arm-none-eabi-gcc:gcc-arm-none-eabi qemu-system-arm:qemu-system-arm openssl:openssl \
         cmake:cmake qemu-aarch64:qemu-user chromium:chromium
LIBRARIES := libtbb12 libc6-arm64-cross

# Each worker has a stretch of the tests, so that a module's fixtures are made once; who is done takes of another's.
WORKERS := -n auto --dist worksteal

test: tools
	$(BIN)/python -m pytest $(WORKERS)

# The same with the share of lines that run; counting them takes a quarter to a half longer.
coverage: tools
	$(BIN)/python -m pytest $(WORKERS) --cov --cov-report=
	@echo "coverage $$($(BIN)/python -m coverage report --format=total) % of the lines of models, codegen, fmus and harness"

tools: .venv/ready
	@if [ "$$(id -u)" = 0 ]; then \
	    for tool in $(TOOLS); do command -v $${tool%%:*} >/dev/null || packages="$$packages $${tool##*:}"; done; \
	    for library in $(LIBRARIES); do dpkg -s $$library >/dev/null 2>&1 || packages="$$packages $$library"; done; \
	    [ -z "$$packages" ] || { apt-get update -qq && apt-get install -y -qq --no-install-recommends $$packages; }; \
	fi || true
	@$(BIN)/python -m codegen.toolchains.sdcc >/dev/null || true

# The firmware over a whole trial on the simulated processors, every tick compared with this machine's.
pil: .venv/ready
	@$(BIN)/python -m codegen.toolchains.sdcc >/dev/null
	$(BIN)/canine pil --target cortex-m4f
	$(BIN)/canine pil --target rabbit4000

lint: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/ready
	$(BIN)/python -m tests.bench

# Small faults in the safety code that no test notices; ONLY=link.c, ONLY=cmec.py:120 or ONLY="part of a line".
mutants: .venv/ready
	@$(BIN)/python -m tests.mutants $(if $(ONLY),"$(ONLY)") $(if $(JOBS),--jobs $(JOBS))

clean:
	rm -rf .venv out fmus/build .coverage

.venv/ready: uv.lock pyproject.toml
	$(PYTHON) -m venv .venv || { echo "A virtual environment could not be made; on Debian: apt install python3-venv" >&2; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check $(UV)
	$(BIN)/uv sync --frozen --inexact --quiet
	touch $@
