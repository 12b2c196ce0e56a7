# quadmeshd: make [config=release|debug|check|asan|tsan|coverage|fuzz] [all|test|prove|demo|bench|check-layers|format|clean]
#
# release leaves build/quadmeshd and build/quadmesh; every other config builds in build/<config>/.
# Local overrides (CC, CFLAGS_EXTRA, ...) go into Makefile.config, which is not kept under version control.

config ?= release
-include Makefile.config

CC ?= gcc
CXX ?= g++
OUT := $(if $(filter release,$(config)),build,build/$(config))
OBJ := build/obj/$(config)

CONFIG_FLAGS_release  := -O3 -DNDEBUG -g1
CONFIG_FLAGS_debug    := -O0 -g3
# -g1: what a report tells is the lines of calls, and variables take a quarter of the time to compile.
CONFIG_FLAGS_asan     := -O1 -g1 -fno-omit-frame-pointer -fsanitize=address,undefined -fno-sanitize-recover=all
# Assertions on, as fast as they allow: for tests that search for long.
CONFIG_FLAGS_check    := -O2 -g1 -fsanitize=undefined -fno-sanitize-recover=all
CONFIG_FLAGS_tsan     := -O2 -g -fno-omit-frame-pointer -fsanitize=thread
CONFIG_FLAGS_coverage := -O0 -g --coverage
# Only clang has libFuzzer; its warnings are not those that this code is kept clean of.
CONFIG_FLAGS_fuzz     := -O1 -g1 -fno-omit-frame-pointer -fsanitize=fuzzer-no-link,address,undefined \
    -fno-sanitize-recover=all -w
# Builds for tests have points of failure by name (server/base/failpoint.h).
CONFIG_FLAGS := $(CONFIG_FLAGS_$(config)) $(if $(filter asan check tsan,$(config)),-DQM_FAILPOINTS)
ifeq ($(CONFIG_FLAGS_$(config)),)
$(error unknown config '$(config)': release, debug, check, asan, tsan, coverage or fuzz)
endif
ifeq ($(config),fuzz)
CC  := clang
CXX := clang++
endif

# No contraction of a * b + c: every kernel then gives the same bits on every machine.
WARNINGS := -Wall -Wextra -Wshadow -Wconversion -Werror
CFLAGS   := -std=c17 $(WARNINGS) $(CONFIG_FLAGS) -ffp-contract=off -fno-math-errno $(CFLAGS_EXTRA)
CXXFLAGS := -std=c++17 $(WARNINGS) $(CONFIG_FLAGS) $(CFLAGS_EXTRA)
LDFLAGS  := $(filter -fsanitize% --coverage,$(CONFIG_FLAGS))

# The engine may use ISO C and the monotonic clock, and sees no header but its own.
ENGINE_FLAGS := -D_POSIX_C_SOURCE=200809L -Iengine/include -Iengine/src
# What numbers are compared with teaches a fuzzer nothing about geometry, and takes half of its time.
ENGINE_FLAGS += $(if $(filter fuzz,$(config)),-fno-sanitize-coverage=trace-cmp)

PACKAGES := libmicrohttpd libuv libcjson sqlite3 nettle zlib expat
# libcurl is loaded when a daemon is to be asked, and libspng when a picture is to be written.
LIBRARY_CFLAGS = $(shell pkg-config --cflags $(PACKAGES) libcurl spng)
# A command line often runs for milliseconds: to find the symbols of shared C++ libraries took one, and to load those of
# C a quarter of one.
CXX_LIBS       = -ldraco -lstdc++
C_LIBS         = $(shell pkg-config --libs zlib nettle expat)
ifeq ($(config),release)
CXX_LIBS       = -Wl,-Bstatic -ldraco -lstdc++ -Wl,-Bdynamic -static-libgcc
C_LIBS         = -Wl,-Bstatic $(shell pkg-config --libs zlib nettle expat) -Wl,-Bdynamic
endif
LIBRARY_LIBS   = $(shell pkg-config --libs $(PACKAGES)) $(CXX_LIBS) -lm -lpthread
# The command line is linked without the libraries that only the daemon uses.
CLI_LIBS       = $(shell pkg-config --libs libcjson) $(C_LIBS) $(CXX_LIBS) -lm -lpthread

# What the command line and the daemon share: an archive of its own, which needs no library of the daemon's.
SHARED_ROOMS   := base format ops report

ENGINE_SOURCES := $(wildcard engine/src/*/*.c)
KERNEL_SOURCES := $(wildcard engine/src/bvh/kernel/*.c)
SHARED_SOURCES := $(wildcard $(SHARED_ROOMS:%=server/%/*.c))
SHIM_SOURCES   := $(wildcard server/format/*.cc)
SERVER_SOURCES := $(filter-out $(SHARED_SOURCES),$(wildcard server/*/*.c))
CLI_SOURCES    := $(wildcard clients/cli/*.c)
UNIT_SOURCES   := $(wildcard tests/unit/test_*.c)
SUPPORT_SOURCES := $(wildcard tests/support/*.c)
FUZZ_SOURCES   := $(wildcard tests/fuzz/fuzz_*.c)
BENCH_SOURCES  := $(wildcard tests/bench/*.c)
PROVE_SOURCES  := $(wildcard tests/prove/*.c)

# The kernels are compiled once for each instruction set; engine/src/bvh/kernel.c picks one at run time.
KERNEL_ISAS := portable avx2 avx512
ISA_FLAGS_portable :=
# -Wno-psabi: wide vectors are only passed between inline functions.
ISA_FLAGS_avx2     := -mavx2 -mbmi2
ISA_FLAGS_avx512   := -mavx512f -mavx512vl -mavx512dq -mavx512bw -mbmi2 -mprefer-vector-width=512

ENGINE_OBJECTS := $(ENGINE_SOURCES:%.c=$(OBJ)/%.o) \
    $(foreach isa,$(KERNEL_ISAS),$(KERNEL_SOURCES:engine/src/bvh/kernel/%.c=$(OBJ)/kernel-$(isa)/%.o))
SHARED_OBJECTS  := $(SHARED_SOURCES:%.c=$(OBJ)/%.o) $(SHIM_SOURCES:%.cc=$(OBJ)/%.o)
SERVER_OBJECTS  := $(SERVER_SOURCES:%.c=$(OBJ)/%.o)
CLI_OBJECTS     := $(CLI_SOURCES:%.c=$(OBJ)/%.o)
SUPPORT_OBJECTS := $(SUPPORT_SOURCES:%.c=$(OBJ)/%.o)
# The references of the proofs, without the parts of support that need cmocka.
PROVE_OBJECTS   := $(PROVE_SOURCES:%.c=$(OBJ)/%.o) \
    $(patsubst %,$(OBJ)/tests/support/%.o,random regridded shapes wide_surface wide_farthest)
BENCH_OBJECTS   := $(BENCH_SOURCES:%.c=$(OBJ)/%.o) $(OBJ)/tests/support/random.o
UNIT_PROGRAMS   := $(UNIT_SOURCES:tests/unit/%.c=$(OUT)/tests/%)

# What the daemon serves at / and /openapi.yaml; it looks for this folder beside its program.
PAGE := $(OUT)/dashboard
PAGE_SOURCES  := $(foreach kind,html css js svg,$(wildcard clients/dashboard/*.$(kind) clients/dashboard/*/*.$(kind)))
CLIENT_SOURCES := $(wildcard clients/js/*.js)
VENDOR_FILES  := three.module.js three.core.js OrbitControls.js mesh-bvh.js
PAGE_FILES    := $(PAGE_SOURCES:clients/dashboard/%=$(PAGE)/%) $(CLIENT_SOURCES:clients/js/%=$(PAGE)/js/%) \
    $(PAGE)/openapi.yaml $(PAGE)/docs.html $(PAGE)/docs.js
# The viewer of the description at /docs.
VIEWER_FILES  := swagger-ui-bundle.js swagger-ui.css

all: $(OUT)/quadmeshd $(OUT)/quadmesh page

# Without npm or its registry the page has everything but its 3D view, and /docs is empty; make says so.
page: $(PAGE_FILES)
	@$(MAKE) -s $(VENDOR_FILES:%=$(PAGE)/vendor/%) $(VIEWER_FILES:%=$(PAGE)/%) 2>/dev/null || \
	    echo "make: npm could not fetch three.js and swagger-ui: / will have no 3D view, /docs no text" >&2

define COPY
@mkdir -p $(@D)
cp $< $@
endef

$(PAGE)/openapi.yaml: proto/openapi.yaml
	$(COPY)
$(PAGE)/js/%: clients/js/%
	$(COPY)
$(PAGE)/docs.%: clients/docs/docs.%
	$(COPY)
$(PAGE)/%: clients/dashboard/%
	$(COPY)

# Fetches what a package.json pins, exactly as its lock file has it; npm writes the target last.
%/node_modules/.package-lock.json: %/package-lock.json
	npm ci --prefix $* --ignore-scripts --no-audit --no-fund --loglevel=error
	@touch $@
npm: $(addsuffix /node_modules/.package-lock.json,clients/js clients/dashboard clients/docs tests/browser)

# They name three.js as it lies beside them, for workers have no import map.
MODULES := clients/dashboard/node_modules
VENDOR_three.module.js := three/build/three.module.js
VENDOR_three.core.js   := three/build/three.core.js
VENDOR_OrbitControls.js    := three/examples/jsm/controls/OrbitControls.js
VENDOR_mesh-bvh.js         := three-mesh-bvh/build/index.module.js
$(PAGE)/vendor/%: $(MODULES)/.package-lock.json
	@mkdir -p $(@D)
	sed "s#from 'three';#from './three.module.js';#" $(MODULES)/$(VENDOR_$*) >$@
$(VIEWER_FILES:%=$(PAGE)/%): $(PAGE)/%: clients/docs/node_modules/.package-lock.json
	@mkdir -p $(@D)
	cp clients/docs/node_modules/swagger-ui-dist/$* $@

# The engine's locks are those of <threads.h>, which ThreadSanitizer does not see.
PROGRAM_EXTRA := $(if $(filter tsan,$(config)),$(OBJ)/tests/support/tsan_locks.o)

$(OUT)/quadmeshd: $(OBJ)/server/main.o $(PROGRAM_EXTRA) $(OBJ)/libserver.a $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS) -o $@ $^ $(LIBRARY_LIBS)

$(OUT)/quadmesh: $(CLI_OBJECTS) $(PROGRAM_EXTRA) $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS) -o $@ $^ $(CLI_LIBS)

# Empty where all that is made does without what only the daemon has.
SERVER_ARCHIVE := $(OBJ)/libserver.a
$(OUT)/tests/%: $(OBJ)/tests/unit/%.o $(OBJ)/libsupport.a $(SERVER_ARCHIVE) $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS) -o $@ $^ -lcmocka $(LIBRARY_LIBS)

$(OUT)/bench/bench_engine: $(BENCH_OBJECTS) $(OBJ)/libserver.a $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS) -o $@ $^ $(LIBRARY_LIBS)

$(OUT)/prove/prove: $(PROVE_OBJECTS) $(OBJ)/libserver.a $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CC) $(LDFLAGS) -o $@ $^ $(LIBRARY_LIBS)

$(OBJ)/libengine.a: $(ENGINE_OBJECTS)
	@rm -f $@
	$(AR) rcs $@ $^
$(OBJ)/libshared.a: $(SHARED_OBJECTS)
	@rm -f $@
	$(AR) rcs $@ $^
$(OBJ)/libserver.a: $(SERVER_OBJECTS)
	@rm -f $@
	$(AR) rcs $@ $^
# An archive: a program gets no part of it that needs what the program is linked without.
$(OBJ)/libsupport.a: $(SUPPORT_OBJECTS)
	@rm -f $@
	$(AR) rcs $@ $^

define COMPILE
@mkdir -p $(@D)
$(CC) $(CFLAGS) -MMD -MP $(1) -c $< -o $@
endef

define KERNEL_RULE
$(OBJ)/kernel-$(1)/%.o: engine/src/bvh/kernel/%.c
	$$(call COMPILE,$(ENGINE_FLAGS) -Wno-psabi -DQM_ISA=$(1) $$(ISA_FLAGS_$(1)))
endef
$(foreach isa,$(KERNEL_ISAS),$(eval $(call KERNEL_RULE,$(isa))))

$(OBJ)/engine/%.o: engine/%.c
	$(call COMPILE,$(ENGINE_FLAGS))
$(OBJ)/server/%.o: server/%.c
	$(call COMPILE,-Iengine/include -Iserver -D_GNU_SOURCE $(LIBRARY_CFLAGS))
$(OBJ)/server/%.o: server/%.cc
	@mkdir -p $(@D)
	$(CXX) $(CXXFLAGS) -MMD -MP -Iengine/include -Iserver -c $< -o $@
$(OBJ)/clients/%.o: clients/%.c
	$(call COMPILE,-Iengine/include -Iserver -D_GNU_SOURCE $(LIBRARY_CFLAGS))
$(OBJ)/tests/%.o: tests/%.c
	$(call COMPILE,-Iengine/include -Iengine/src -Iserver -Itests/support -D_GNU_SOURCE $(LIBRARY_CFLAGS))
$(OBJ)/tests/%.o: tests/%.cc
	@mkdir -p $(@D)
	$(CXX) $(CXXFLAGS) -MMD -MP -c $< -o $@

unit-programs: $(UNIT_PROGRAMS)

# Everything, from a bare Debian 12 on.
test:
	@sh tests/run.sh

# Holds the engine's answers on random cases against certified references, for a quarter of an hour on two processors.
PROVE_SECONDS ?= 900
PROVE_SEED    ?= 1
PROVE_JOBS    ?= 2
prove: $(OUT)/prove/prove
	@$< --seconds $(PROVE_SECONDS) --seed $(PROVE_SEED) --jobs $(PROVE_JOBS)

# Runs the unit tests of this config alone.
unit: $(UNIT_PROGRAMS)
	@set -e; for program in $(UNIT_PROGRAMS); do $$program; done

# The tests against a running daemon once more, for races. Generated requests and times would only take longer, the allocator
# that fails has no place under this sanitizer, and it takes memory of its own for each byte of an answer.
test-tsan:
	@$(MAKE) -s config=tsan all
	QM_BUILD=build/tsan QM_PATIENCE=600 build/venv/bin/pytest -q -p no:cacheprovider --timeout 900 tests/api \
	    -k "not generated and not test_deployment and not test_kills and not test_memory_faults" -m "not bounds_memory"
	QM_TEST_STORE=shared QM_BUILD=build/tsan QM_PATIENCE=600 tests/with_postgres.sh build/venv/bin/pytest -q \
	    -p no:cacheprovider --timeout 900 -m "not bounds_memory" $$(cat tests/api/shared_store.txt)

# Breaks a cluster of daemons on a PostgreSQL with a standby in many ways (QM_TEST_LONG=1: for long), in about ten minutes.
test-cluster: all
	docker/install-packages.sh test
	[ -x build/venv/bin/pytest ] || python3 -m venv build/venv
	build/venv/bin/pip install --quiet --disable-pip-version-check -r tests/cluster/requirements.txt
	build/venv/bin/pytest -q -p no:cacheprovider -n 3 tests/cluster
	@$(MAKE) -s config=asan all
	QM_BUILD=build/asan build/venv/bin/pytest -q -p no:cacheprovider -n 3 tests/cluster/test_points.py

# Proves that the engine stands alone, that each outside library has its own files, and that folders use what lies below them.
check-layers: $(OBJ)/libengine.a
	@CC="$(CC)" LDFLAGS="$(LDFLAGS)" tests/check_layers.sh $<
	@python3 tests/check_rooms.py

# Installs what is missing, builds, and shows the daemon at work on loopback.
demo:
	@clients/demo/run.sh

# The same of three daemons that share a PostgreSQL with a standby, one of which is killed.
demo-cluster:
	@clients/demo/cluster.sh

# Times this engine and its peers side by side; BENCH="--quick --pairs bunny" and the like go to run.py.
bench:
	@python3 tests/bench/run.py $(BENCH)

# The peers' own code is compiled for this very machine; CGAL's exact predicates need its rounding and no contraction.
BENCH_PEER_FLAGS := -O3 -DNDEBUG -march=native -ffp-contract=off -Itests/bench
build/bench/peer_cgal: tests/bench/peers/peer_cgal.cc tests/bench/arrays.h tests/bench/measure.h tests/bench/pair_print.h
	@mkdir -p $(@D)
	$(CXX) -std=c++17 -Wall -Wextra $(BENCH_PEER_FLAGS) -frounding-math -o $@ $< -lgmp -lmpfr
build/bench/peer_fcl: tests/bench/peers/peer_fcl.cc tests/bench/arrays.h tests/bench/measure.h tests/bench/pair_print.h
	@mkdir -p $(@D)
	$(CXX) -std=c++17 -Wall -Wextra $(BENCH_PEER_FLAGS) -isystem /usr/include/eigen3 -o $@ $< -lfcl -lccd
build/bench/peer_embree_collide: tests/bench/peers/peer_embree_collide.c tests/bench/arrays.h tests/bench/measure.h tests/bench/pair_print.h
	@mkdir -p $(@D)
	$(CC) -std=c17 -D_GNU_SOURCE $(WARNINGS) $(BENCH_PEER_FLAGS) -o $@ $< -lembree3
build/bench/peer_embree: tests/bench/peers/peer_embree.c tests/bench/arrays.h tests/bench/measure.h
	@mkdir -p $(@D)
	$(CC) -std=c17 -D_GNU_SOURCE $(WARNINGS) $(BENCH_PEER_FLAGS) -o $@ $< -lembree3 -lm

# Fuzzes decoders, JSON requests, engine and layouts, FUZZ_SECONDS each; findings are left in build/fuzz.
fuzz:
	@$(MAKE) -s config=fuzz fuzz-programs
	@tests/fuzz/run.sh
fuzz-programs: $(FUZZ_SOURCES:tests/fuzz/%.c=$(OUT)/%)

$(OUT)/fuzz_%: $(OBJ)/tests/fuzz/fuzz_%.o $(OBJ)/tests/fuzz/soup.o $(OBJ)/tests/fuzz/sheet.o $(OBJ)/tests/fuzz/new_limit.o $(OBJ)/libsupport.a $(OBJ)/libserver.a $(OBJ)/libshared.a $(OBJ)/libengine.a
	@mkdir -p $(@D)
	$(CXX) -fsanitize=fuzzer,address,undefined -o $@ $^ -lcmocka $(LIBRARY_LIBS)

clean:
	rm -rf build

format:
	clang-format -i $$(git ls-files '*.c' '*.h' '*.cc')

-include $(foreach folder,$(wildcard $(OBJ)),$(shell find $(folder) -name '*.d'))
# The types of the client and of the page.
check-types: npm
	clients/js/node_modules/.bin/tsc -p clients/js
	clients/js/node_modules/.bin/tsc -p clients/dashboard
	clients/js/node_modules/.bin/openapi-typescript proto/openapi.yaml --default-non-nullable false -o $(OUT)/api.d.ts
	clients/js/node_modules/.bin/tsc --noEmit --strict $(OUT)/api.d.ts

.PHONY: all page npm check-types test test-tsan test-cluster prove unit-programs unit check-layers demo demo-cluster bench fuzz fuzz-programs clean format
.SECONDARY:
