# Every target makes the set-up it needs in .venv; "make help" lists them.
.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help setup run test test-all on-2-ranks on-3-ranks lint verification bench docs dist check-paraview clean

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.set-up
COMPILED := $(VENV)/.compiled
BENCH_STAMP := $(VENV)/.set-up-bench
EXTRAS := dolfinx,post,test,fmi,docs
# A user's own scripts may lie beside these.
SOURCES := flexfem cases examples meshes postprocess tests
CASE ?= slider_crank
# More ranks than cores wait for one another. To nproc, threads are cores.
RANKS := $(shell test "$$(env -u OMP_NUM_THREADS nproc 2>/dev/null || echo 1)" -ge 2 && echo 2 || echo 1)

# Ranks share the cores; threads of BLAS and OpenMP on top make timings and sums vary.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
# Hundreds of short runs would compile the package's Python each time.
unexport PYTHONDONTWRITEBYTECODE

help: ## this list
	@awk -F ':.*## ' '/^[a-z-]+:.*## /{printf "make %-16s %s\n", $$1, $$2}' Makefile

setup: $(COMPILED) ## make .venv with all that flexfem needs, and compile for mechanisms

$(STAMP): pyproject.toml .ci/setup
	@sh .ci/setup $(VENV) $(EXTRAS)
	@touch $@

# What beams, rigid bodies and joints need: no first run waits for it. Faults show when they are run.
$(COMPILED): $(STAMP)
	@echo "setup: compiling loops and forms of mechanisms, once, for a minute or two"
	@-$(BIN)/flexfem compile --quiet slider_crank deployable_truss
	@touch $@

$(BENCH_STAMP): $(STAMP)
	@sh .ci/setup $(VENV) $(EXTRAS),bench
	@touch $@

run: $(COMPILED) ## run a case on 2 ranks and draw it (CASE=slider_crank)
	@echo "(the first run with another kind of body compiles what it needs before it starts)"
	$(BIN)/mpirun -n $(RANKS) $(BIN)/flexfem run $(CASE)
	$(BIN)/flexfem render results/$(CASE)
	$(BIN)/flexfem plot results/$(CASE)
	@echo "files made in results/$(CASE):"
	@find results/$(CASE) -type f ! -name '*vtu' | sort
	@echo "and $$(find results/$(CASE) -type f -name '*vtu' | wc -l) ParaView field files"

lint: $(STAMP) ## style, types, architecture
	$(BIN)/ruff check $(SOURCES)
	$(BIN)/ruff format --check $(SOURCES)
	$(BIN)/mypy flexfem
	$(BIN)/python -m pytest -q tests/test_architecture.py

# Tests compile generated C more often than they need it fast: without optimisation a seventh of the time.
test test-all: export FLEXFEM_CFLAGS := -O0 -march=native -fno-math-errno
# MPICH polls while it waits: three ranks on two cores need a third of the time if they sleep instead.
test test-all: export MPIR_CVAR_ENABLE_HEAVY_YIELD := 1
test: NOT_SLOW := and not slow
test: NOT_SLOW_ON_RANKS := and not (slow or slow_on_ranks)
test: NOT_ON_THREE := and not three_ranks
test: $(STAMP) ## lint, documentation, then tests on 1, 2 and 3 ranks: for every change
test-all: $(STAMP) ## the same with the tests that are slow: before a release
test test-all:
	# linters take one core longest: beside them, loops that many tests need are compiled
	@$(MAKE) --no-print-directory -j $(RANKS) lint compiled-floating compiled-sliding docs
	# what a file's tests share is made once; files as they come, the longest are not the last
	$(BIN)/python -m pytest -m "not (benchmark or several_ranks) $(NOT_SLOW)" -n $(RANKS) --dist loadfile --no-loadscope-reorder \
		--ignore tests/test_architecture.py
	# ranks that wait leave half of two cores idle: both at once
	@$(MAKE) --no-print-directory -j $(RANKS) --output-sync=target on-2-ranks on-3-ranks \
		NOT_SLOW_ON_RANKS="$(NOT_SLOW_ON_RANKS)" NOT_ON_THREE="$(NOT_ON_THREE)"

on-2-ranks: $(STAMP)
	$(BIN)/mpirun -n 2 $(BIN)/python -m mpi4py -m pytest -m "not (benchmark or serial) $(NOT_SLOW_ON_RANKS) $(NOT_ON_THREE)" tests

on-3-ranks: $(STAMP)
	$(BIN)/mpirun -n 3 $(BIN)/python -m mpi4py -m pytest -m "three_ranks $(NOT_SLOW_ON_RANKS)" tests

# what two processes of tests would wait for at the same time
compiled-%: $(STAMP)
	@$(BIN)/python -m tests.warm_up $*

verification: $(STAMP) ## all benchmarks at full meshes: writes tests/verification/TABLE.md
	$(BIN)/python -m tests.verification.table

bench: $(BENCH_STAMP) ## timings, against Exudyn where it has the same problem
	$(BIN)/python tests/benchmarks/chain_against_exudyn.py --ranks 2
	$(BIN)/python -m tests.benchmarks.large_systems --systems rigid --sizes 16,64,256,1024 --ranks 1

docs: $(STAMP) ## the documentation: build/docs/html/index.html
	$(BIN)/python -m sphinx -b html -W --keep-going -q flexfem/docs build/docs/html
	@echo "open build/docs/html/index.html"

dist: $(STAMP) ## wheel and sdist in dist/
	$(BIN)/python -m hatchling build -d dist

check-paraview: $(STAMP) ## open short runs of all cases, on 1 and 2 ranks, in the installed ParaView
	@set -e; folders=; for case in $$(cd cases && ls *.py | sed 's/\.py$$//'); do \
		for ranks in 1 $(RANKS); do \
			folder=results/check-paraview/$$case-$$ranks; folders="$$folders $$folder"; \
			$(BIN)/mpirun -n $$ranks $(BIN)/flexfem run $$case --smoke --output $$folder; \
		done; \
	done; sh tests/paraview/check.sh $$(find $$folders -name '*.pvd' -printf '%h\n' | sort -u)

clean: ## remove .venv, results and caches
	rm -rf $(VENV) results build dist .pytest_cache .mypy_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
