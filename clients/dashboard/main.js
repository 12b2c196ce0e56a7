// The page at /: meshes, one Hausdorff job that is watched, and the list of jobs. All state is here; all
// drawing happens in the draw functions below.

const state = {
  meshes: [],
  jobs: [],
  a: null, // ids of the chosen meshes
  b: null,
  watched: null, // AbortController of the stream that is read
  watchedJob: null, // id of the job whose bounds are shown
};

const byId = (id) => document.getElementById(id);

function say(text, isFault = false) {
  const message = byId("message");
  message.textContent = text;
  message.classList.toggle("fault", isFault);
  message.hidden = text === "";
}

// What a reply that is not ok says, in one sentence.
async function faultOf(response) {
  const problem = await response.json().catch(() => null);
  if (!problem) return `the daemon answered ${response.status}`;
  const places = (problem.errors ?? []).map((error) => {
    if (error.pointer) return error.pointer;
    return error.line === undefined ? `byte ${error.offset}` : `line ${error.line}`;
  });
  return problem.detail + (places.length > 0 ? ` (${places.join(", ")})` : "");
}

async function call(path, options) {
  const response = await fetch(path, options);
  if (!response.ok) throw new Error(await faultOf(response));
  return response;
}

// Every page of a list.
async function listAll(path, key) {
  const entries = [];
  for (let next = ""; next !== null;) {
    const page = await (await call(path + (next ? `?cursor=${encodeURIComponent(next)}` : ""))).json();
    entries.push(...page[key]);
    next = page.next;
  }
  return entries;
}

// ---- drawing ----

function cell(content, className = "") {
  const td = document.createElement("td");
  td.className = className;
  td.append(content);
  return td;
}

function button(text, label, action) {
  const element = document.createElement("button");
  element.type = "button";
  element.textContent = text;
  element.setAttribute("aria-label", label);
  element.addEventListener("click", () => action().catch((error) => say(error.message, true)));
  return element;
}

function choice(side, mesh) {
  const input = document.createElement("input");
  input.type = "radio";
  input.name = `mesh-${side}`;
  input.checked = state[side] === mesh.id;
  input.setAttribute("aria-label", `${mesh.name || mesh.id} as ${side.toUpperCase()}`);
  input.addEventListener("change", () => {
    state[side] = mesh.id;
  });
  return input;
}

const nameOf = (id) => state.meshes.find((mesh) => mesh.id === id)?.name || id;
const distance = (value) => (value === null || value === undefined ? "–" : value.toPrecision(10));

function drawMeshes() {
  byId("meshes").replaceChildren(...state.meshes.map((mesh) => {
    const row = document.createElement("tr");
    const { triangles, quads, polygons } = mesh.faces;
    row.append(
      cell(choice("a", mesh)), cell(choice("b", mesh)), cell(mesh.name || mesh.id), cell(mesh.kind),
      cell(mesh.vertices.toLocaleString(), "number"),
      cell((triangles + quads + polygons).toLocaleString(), "number"),
      cell(mesh.bounding_box.diagonal.toPrecision(6), "number"), cell(mesh.warnings.join("; ")),
      cell(button("Delete", `delete ${mesh.name || mesh.id}`, () => remove(mesh.id))),
    );
    return row;
  }));
  byId("no-meshes").hidden = state.meshes.length > 0;
}

function drawJobs() {
  byId("jobs").replaceChildren(...state.jobs.map((job) => {
    const bounds = job.result ?? job.progress ?? {};
    const row = document.createElement("tr");
    row.append(
      cell(new Date(job.created).toLocaleString()), cell(nameOf(job.request.a)), cell(nameOf(job.request.b)),
      cell(job.problem ? `${job.state}: ${job.problem.detail}` : job.state),
      cell(distance(bounds.lower), "number"), cell(distance(bounds.upper), "number"),
      cell(button("Show", `show job ${job.id}`, () => watchJob(job))),
    );
    return row;
  }));
  byId("no-jobs").hidden = state.jobs.length > 0;
}

function drawBounds(bounds, gap) {
  byId("lower").textContent = distance(bounds.lower);
  byId("upper").textContent = distance(bounds.upper);
  byId("gap").textContent = gap === null ? "–" : gap.toExponential(3);
  byId("iterations").textContent = bounds.iterations.toLocaleString();
  byId("elapsed").textContent = `${bounds.elapsed_ms.toFixed(1)} ms`;
}

function drawEvent(event) {
  if (event.event === "bounds") {
    drawBounds(event, event.gap_relative);
  } else if (event.event === "result") {
    const { result } = event;
    drawBounds(result, result.upper === null ? null : result.upper_relative - result.lower_relative);
    byId("outcome").textContent = `${event.state}: the distance lies between ${result.lower} and ${result.upper}`;
  } else if (event.event === "error") {
    byId("outcome").textContent = `${event.state}: ${event.problem.detail}`;
  } else if (event.event === "server_shutdown") {
    byId("outcome").textContent = event.detail;
  }
}

// ---- actions ----

async function refresh() {
  [state.meshes, state.jobs] = await Promise.all([
    listAll("/v1/meshes", "meshes"), listAll("/v1/jobs", "jobs"),
  ]);
  state.jobs.reverse(); // newest first
  drawMeshes();
  drawJobs();
}

async function upload(files) {
  for (const file of files) {
    say(`uploading ${file.name} …`);
    const path = `/v1/meshes?name=${encodeURIComponent(file.name)}`;
    const headers = { "Content-Type": "application/octet-stream" };
    try {
      const mesh = await (await call(path, { method: "POST", headers, body: file })).json();
      if (state.a === null) state.a = mesh.id;
      else if (state.b === null) state.b = mesh.id;
      say(`${file.name} is here`);
    } catch (error) {
      say(`${file.name}: ${error.message}`, true);
      break;
    }
  }
  await refresh();
}

async function remove(id) {
  await call(`/v1/meshes/${id}`, { method: "DELETE" });
  if (state.a === id) state.a = null;
  if (state.b === id) state.b = null;
  await refresh();
}

// Hands each line of an NDJSON body to onEvent as it comes.
async function readEvents(response, onEvent) {
  const reader = response.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    if (done) return;
    const lines = (rest + value).split("\n");
    rest = lines.pop();
    lines.filter((line) => line !== "").map((line) => JSON.parse(line)).forEach(onEvent);
  }
}

// Shows a job's events from the first one on; a job that was shown before goes on without us.
async function watchJob(job) {
  state.watched?.abort();
  const watched = new AbortController();
  state.watched = watched;
  state.watchedJob = job.id;
  byId("pair").textContent = `A: ${nameOf(job.request.a)}, B: ${nameOf(job.request.b)}`;
  byId("outcome").textContent = "";
  for (const id of ["lower", "upper", "gap", "iterations", "elapsed"]) byId(id).textContent = "–";
  byId("live").hidden = false;
  byId("cancel").disabled = false;
  let ended = false;
  try {
    const headers = { Accept: "application/x-ndjson" };
    const response = await call(`/v1/jobs/${job.id}/events`, { headers, signal: watched.signal });
    await readEvents(response, (event) => {
      ended ||= ["result", "error", "server_shutdown"].includes(event.event);
      drawEvent(event);
    });
    if (!ended) say("the stream broke off; show the job again to go on", true);
  } catch (error) {
    if (error.name !== "AbortError") throw error;
    return;
  }
  byId("cancel").disabled = true;
  await refresh();
}

async function measure(form) {
  if (state.a === null || state.b === null) {
    say("choose a mesh as A and a mesh as B", true);
    return;
  }
  say("");
  const fields = new FormData(form);
  const request = {
    type: "hausdorff", a: state.a, b: state.b, direction: fields.get("direction"), quads: fields.get("quads"),
    tolerance: Number(fields.get("tolerance")),
  };
  const headers = { "Content-Type": "application/json" };
  const response = await call("/v1/jobs", { method: "POST", headers, body: JSON.stringify(request) });
  await watchJob(await response.json());
}

async function cancel() {
  await call(`/v1/jobs/${state.watchedJob}`, { method: "DELETE" });
}

// ---- events of the page ----

const run = (promise) => promise.catch((error) => say(error.message, true));

byId("files").addEventListener("change", (event) => {
  run(upload([...event.target.files]));
  event.target.value = "";
});
const drop = byId("drop");
for (const kind of ["dragenter", "dragover"]) {
  drop.addEventListener(kind, (event) => {
    event.preventDefault();
    drop.classList.add("over");
  });
}
drop.addEventListener("dragleave", () => drop.classList.remove("over"));
drop.addEventListener("drop", (event) => {
  event.preventDefault();
  drop.classList.remove("over");
  run(upload([...event.dataTransfer.files]));
});
byId("measure").addEventListener("submit", (event) => {
  event.preventDefault();
  run(measure(event.target));
});
byId("cancel").addEventListener("click", () => run(cancel()));

async function start() {
  const info = await (await call("/v1/info")).json();
  byId("daemon").textContent = `version ${info.version}, ${info.kernel} kernels`;
  await refresh();
}
run(start());
