// The pages that find collisions and deform.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { Daemon, until } from "./support/daemon.js";
import { Browser, finish, fly, rest, waitForView } from "./support/page.js";
import { ball, box, moved, off, sphere } from "./support/shapes.js";

let daemon;
let browser;
let ids;
before(async () => {
  daemon = await Daemon.start();
  browser = await Browser.launch();
  ids = {};
  const inner = { ...box(2), vertices: box(2).vertices.map((point) => point.map((x) => 0.3 + 0.4 * x)) };
  const open = { ...box(2), faces: box(2).faces.slice(1) };
  for (const [name, mesh] of Object.entries({ one: box(4), near: moved(box(4), [0.75, 0.3, 0.3]), far: moved(box(4), [3, 0, 0]), ball: ball(16), inner, open,
    beside: moved(box(4), [1, 0, 0]), small: moved(sphere(0, 8, 16), [0.2, 0.1, 0]) })) {
    ids[name] = (await daemon.client().meshes.create(off(mesh), { name })).mesh.id;
  }
});
after(async () => {
  await browser.close();
  await daemon.remove();
});

test("contacts are counted, stepped through and flown to; apart, the least distance is shown", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.one}&b=${ids.near}`);
  await waitForView(page);
  await page.getByRole("button", { name: "Find collisions" }).click();
  const job = await daemon.client().jobs.create({ type: "collision", a: ids.one, b: ids.near }, { wait: 30 });
  await page.locator("#collisions", { hasText: `${job.result.count} pairs of faces meet` }).waitFor();
  const contact = page.locator("#contact");
  await page.waitForFunction(() => document.querySelector("#contact").textContent.startsWith("1 of"));
  const [first] = job.result.pairs;
  assert.match(await contact.innerText(), new RegExp(`^1 of ${job.result.count}: faces ${first.faces[0]} and ${first.faces[1]}`));
  await page.getByRole("button", { name: "Next contact" }).click();
  await page.waitForFunction(() => document.querySelector("#contact").textContent.startsWith("2 of"));
  await page.getByRole("button", { name: "Previous contact" }).click();
  await page.getByRole("button", { name: "Previous contact" }).click();
  await page.waitForFunction((count) => document.querySelector("#contact").textContent.startsWith(`${count} of`), job.result.count);

  await page.locator("select[name=b]").selectOption(ids.far);
  await page.getByRole("button", { name: "Find collisions" }).click();
  await page.locator("#collisions", { hasText: "The two do not meet" }).waitFor();
  await page.getByText(/^(2\.000000|1\.999999) to 2\.00000/).waitFor();
  await page.locator("select[name=b]").selectOption("");
  await page.getByRole("button", { name: "Find collisions" }).click();
  await page.locator("#collisions", { hasText: "No faces meet that should not" }).waitFor();
  await finish(page);
});

const pair = (page) => page.evaluate(async () => {
  const { eye: { controls, camera }, frame, pair: { from, to, group } } = (await import("/dashboard/view/view.js")).currentStage();
  const place = (vector) => vector.toArray().map((x, k) => x / frame.scale + frame.centre[k]);
  return { target: place(controls.target), camera: place(camera.position), from: place(from), to: place(to), isShown: group.visible };
});
const near = (one, other, by = 1e-6) => Math.hypot(...one.map((x, k) => x - other[k])) < by;

test("solids: the relation, how deep each reaches into the other, and the deepest places to fly to", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.one}&b=${ids.near}`);
  await waitForView(page);
  const find = () => page.getByRole("button", { name: "Find collisions" }).click();
  await find();
  await page.locator("#relation", { hasText: "The solids reach into each other." }).waitFor();
  const job = await daemon.client().jobs.create({ type: "collision", a: ids.one, b: ids.near, mode: "any", penetration: true }, { wait: 30 });
  const { a_in_b: there, b_in_a: back } = job.result.penetration;
  const cells = await page.locator("#penetration td.number").allInnerTexts();
  for (const [place, { lower, upper }] of [there, back].entries()) {
    const [middle, half] = cells[place].split(" ± ").map(Number);
    assert(middle - half <= lower && middle + half >= upper && 2 * half < 3 * (upper - lower), `${cells} ${lower} ${upper}`);
  }
  await page.waitForFunction(() => document.querySelector("#contact").textContent.startsWith("1 of"));
  for (const [place, { witness }] of [there, back].entries()) {
    await fly(page, () => page.getByRole("list", { name: "Deepest places" }).getByRole("button").nth(place).click());
    const { target, from, to, isShown } = await pair(page);
    assert(isShown && near(from, witness.from.point) && near(to, witness.to.point), `${from} ${to}`);
    assert(near(target, witness.from.point.map((x, k) => (x + witness.to.point[k]) / 2)), target.join());
  }

  // Where they meet, the normals of both faces are told and drawn.
  const [first] = (await daemon.client().jobs.create({ type: "collision", a: ids.one, b: ids.near }, { wait: 30 })).result.pairs;
  const normals = await page.locator("#normals dd").allInnerTexts();
  assert.deepEqual(normals.slice(0, 2).map((text) => text.split(", ").map(Number)), first.normals.map((normal) => normal.map((x) => x + 0)));
  assert.equal(normals[2], "90.0°");
  const drawn = await page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().layers.get("marks").ribbons.slice(-2)
    .map(({ points: [foot, tip] }) => tip.clone().sub(foot).normalize().toArray()));
  assert(drawn.every((way, place) => near(way, first.normals[place])), JSON.stringify(drawn));

  for (const [b, words] of [[ids.far, "The solids are apart."], [ids.inner, "B is inside of A."], [ids.beside, "The solids touch, or reach into each other by no more than 0.03125: more is not known."],
    [ids.open, "They are not taken as solids: "]]) {
    await page.locator("select[name=b]").selectOption(b);
    await find();
    await page.locator("#relation", { hasText: words }).waitFor();
  }
  await page.locator("select[name=a]").selectOption(ids.inner);
  await page.locator("select[name=b]").selectOption(ids.one);
  await find();
  await page.locator("#relation", { hasText: "A is inside of B." }).waitFor();
  await page.getByRole("checkbox", { name: "As solids" }).uncheck();
  await find();
  await page.locator("#collisions", { hasText: "The two do not meet" }).waitFor();
  assert(await page.locator("#relation").isHidden());
  await finish(page);
});

test("the clearance gets its verdict and its nearest points; a link opens the same view", async () => {
  const page = await browser.open(`${daemon.url}/#collide?a=${ids.one}&b=${ids.far}`);
  await waitForView(page);
  const verdict = page.locator("#clearance");
  for (const [limit, words] of [["1.5", "The clearance is above the 1.5 wanted."], ["2.5", "The clearance is not above the 2.5 wanted."]]) {
    await page.getByLabel("Clearance wanted").fill(limit);
    await fly(page, () => page.getByRole("button", { name: "Find collisions" }).click());
    assert.equal(await verdict.innerText(), words);
    const { result } = await daemon.client().jobs.create({ type: "distance", a: ids.one, b: ids.far }, { wait: 30 });
    const [lower, upper] = (await page.getByText(/ to 2\.00000/).innerText()).split(" to ").map(Number);
    assert(Math.abs(lower - result.lower) < 1e-6 && Math.abs(upper - result.upper) < 1e-6);
    const { target, from, to } = await pair(page);
    assert(near(from, result.witness.from.point) && near(to, result.witness.to.point));
    assert(near(target, from.map((x, k) => (x + to[k]) / 2), 1e-4), target.join());
  }
  await page.waitForFunction(() => location.hash.includes("eye=") && location.hash.includes("found=1"));
  await rest(page);
  const other = await browser.open(page.url());
  await other.locator("#clearance", { hasText: "not above the 2.5 wanted" }).waitFor();
  await other.getByText(/ to 2\.00000/).waitFor();
  await rest(other);
  const [here, there] = [await pair(page), await pair(other)];
  assert(["camera", "target", "from", "to"].every((name) => near(here[name], there[name], 1e-5)), JSON.stringify([here, there]));
  await finish(other);

  // Of what meets, the clearance is 0.
  await page.locator("select[name=b]").selectOption(ids.near);
  await page.getByRole("button", { name: "Find collisions" }).click();
  await verdict.filter({ hasText: "The clearance is not above the 2.5 wanted." }).waitFor();
  await page.getByText("0 to 0", { exact: true }).waitFor();
  await page.locator("#relation", { hasText: "reach into" }).waitFor();
  await page.getByRole("button", { name: "Next contact" }).click();
  await page.waitForFunction(() => location.hash.includes("contact=2"));
  const third = await browser.open(page.url());
  await third.waitForFunction(() => document.querySelector("#contact")?.textContent.startsWith("2 of"));
  await finish(third);
  await finish(page);
});

test("a dragged region refits, folds are found as they come, and can be undone", async () => {
  const page = await browser.open(`${daemon.url}/#deform?a=${ids.ball}`);
  await waitForView(page);
  /** That of the copy that the first drag makes; what was uploaded stays. */
  const copy = () => new URLSearchParams(new URL(page.url()).hash.split("?")[1]).get("a");
  const revision = async () => (await daemon.client().meshes.get(copy())).revision;
  await page.getByRole("button", { name: "Take the middle of the view" }).click();
  await page.locator("#folds", { hasText: "The handle is taken" }).waitFor();
  await page.getByRole("button", { name: "Pull out" }).click();
  await page.locator("#folds", { hasText: "No faces meet" }).waitFor();
  assert.notEqual(copy(), ids.ball);
  assert.equal((await daemon.client().meshes.get(copy())).name, "ball, deformed");
  assert.equal(await revision(), 1);
  await page.getByRole("link", { name: "Jobs" }).click(); // Undo outlives the view
  await page.locator('body[data-page="jobs"]').waitFor();
  await page.getByRole("link", { name: "Deform" }).click();
  await waitForView(page);
  await page.getByRole("button", { name: "Undo" }).click();
  await page.locator("#folds", { hasText: "undone" }).waitFor();
  await waitForView(page);

  const view = await page.locator(".canvas canvas").boundingBox();
  const [x, y] = [view.x + view.width / 2, view.y + view.height / 2];
  await page.waitForTimeout(300);
  await page.mouse.move(x, y);
  await page.mouse.down();
  for (const share of [0.3, 0.6, 1]) await page.mouse.move(x + share * 100, y + share * 30);
  await page.mouse.up();
  await page.locator("#folds", { hasText: "No faces meet" }).waitFor();
  assert(await revision() > 2);
  // In through the ball, and out of its other side.
  await page.getByRole("button", { name: "Take the middle of the view" }).click();
  await page.locator("#folds", { hasText: "The handle is taken" }).waitFor();
  for (let step = 0; step < 24; step++) await page.getByRole("button", { name: "Push in" }).click();
  await page.locator("#folds.fault", { hasText: "of faces meet" }).waitFor();
  await until(async () => (await page.locator(".figures dd").first().innerText()) === String(await revision()), "the last revision");
  const job = await daemon.client().jobs.create({ type: "self_collision", mesh: copy() }, { wait: 30 });
  await until(async () => (await page.locator("#folds").innerText()).startsWith(job.result.count.toLocaleString("en")), "the last round");
  assert.equal((await daemon.client().meshes.get(ids.ball)).revision, 0);
  await finish(page);
});

test("a mesh that was moved in Compare is moved in Collide, in links and in the list of jobs too, until it is put back", async () => {
  const shift = [1, 0, 0, 0, 1, 0, 0, 0, 1, -2.25, 0.3, 0.3];
  const page = await browser.open(`${daemon.url}/#compare?a=${ids.far}&b=${ids.one}&pose=${shift}`);
  await waitForView(page);
  await page.locator("#tabs").getByRole("link", { name: "Collide" }).click();
  await page.getByText("A is moved, as Compare aligned it.").waitFor();
  await waitForView(page);
  const box = await page.evaluate(async () => (await import("/dashboard/view/view.js")).currentStage().models.get("a").box);
  assert(near(box.min, [0.75, 0.3, 0.3]), "A is drawn where it was moved to");
  await page.getByRole("button", { name: "Find collisions" }).click();
  const transform = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -2.25, 0.3, 0.3, 1];
  const job = await daemon.client().jobs.create({ type: "collision", a: { mesh: ids.far, transform }, b: ids.one }, { wait: 30 });
  assert(job.result.count > 0);
  await page.locator("#collisions", { hasText: `${job.result.count} pairs of faces meet` }).waitFor();
  await page.locator("#penetration").getByText("Greatest depth").waitFor();
  const link = page.url();
  assert.match(link, /pose=1,0,0,0,1,0,0,0,1,-2.25,0.3,0.3/);
  await finish(page);

  const other = await browser.open(link);
  await other.locator("#collisions", { hasText: `${job.result.count} pairs of faces meet` }).waitFor();
  await other.getByRole("button", { name: "Back to where it lies" }).click();
  await other.getByText("A is moved, as Compare aligned it.").waitFor({ state: "hidden" });
  await other.getByRole("button", { name: "Find collisions" }).click();
  await other.locator("#collisions", { hasText: "The two do not meet" }).waitFor();
  assert(!other.url().includes("pose="));
  await finish(other);

  const jobs = await browser.open(`${daemon.url}/#jobs`);
  await jobs.locator("tbody tr", { hasText: "Collisions" }).filter({ hasText: "far, moved" }).first().getByRole("link").first().click();
  await jobs.locator("#collisions", { hasText: `${job.result.count} pairs of faces meet` }).waitFor();
  await finish(jobs);
});
