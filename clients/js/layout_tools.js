// Tools that edit layouts: several curves by one call. Apart from the client, as most pages draw none:
//
//   import { LayoutTools } from "quadmeshd-client/layout_tools.js";
//   await new LayoutTools(client.layouts).fill(layout.id);

/** @import { CurveMark, EditedLayout, FeatureRequest, LayoutSuggestion, Mirror, Point, Stroke, SymmetryPlane } from "./types.js" */
/** @import { Layouts, Options } from "./layouts.js" */
/** @typedef {Options & { mirror?: Mirror }} MirrorOptions an edit with `mirror` is made on both sides of that plane */

/** @param {Mirror} [mirror] */
const queryOf = (mirror) => (mirror ? `?mirror=${[...mirror.point, ...mirror.normal].join(",")}` : "");

export class LayoutTools {
  /** @param {Layouts} layouts */
  constructor(layouts) {
    this.layouts = layouts;
  }

  /**
   * @param {string} id
   * @param {string} path
   * @param {object} body
   * @param {MirrorOptions} options
   * @returns {Promise<EditedLayout>}
   */
  edit(id, path, body, { mirror, signal }) {
    return this.layouts.post(`/v1/layouts/${encodeURIComponent(id)}/${path}`, mirror ? { ...body, mirror } : body, { signal });
  }

  /**
   * Cuts a curve at its point nearest to a place.
   * @param {string} id
   * @param {number} curve
   * @param {Point} point
   * @param {MirrorOptions} [options]
   */
  split(id, curve, point, options = {}) {
    return this.edit(id, `curves/${curve}/split`, { point }, options);
  }

  /**
   * Joins two curves at a node that is theirs alone.
   * @param {string} id
   * @param {number} first which keeps its id
   * @param {number} second
   * @param {MirrorOptions} [options]
   */
  merge(id, first, second, options = {}) {
    return this.edit(id, "curves/merge", { first, second }, options);
  }

  /**
   * Redraws a curve between its nodes, from either end, by points in space or a stroke in the window.
   * @param {string} id
   * @param {number} curve
   * @param {{ points: Point[] } | Stroke} line
   * @param {MirrorOptions} [options]
   */
  redraw(id, curve, line, options = {}) {
    return this.edit(id, `curves/${curve}/redraw`, line, options);
  }

  /**
   * Takes a curve away.
   * @param {string} id
   * @param {number} curve
   * @param {MirrorOptions} [options]
   * @returns {Promise<EditedLayout>}
   */
  deleteCurve(id, curve, { mirror, signal } = {}) {
    return this.layouts.transport.json(`/v1/layouts/${encodeURIComponent(id)}/curves/${curve}${queryOf(mirror)}`, { method: "DELETE", signal });
  }

  /**
   * Draws a closed curve round a limb by a stroke across it, or by one point.
   * @param {string} id
   * @param {Stroke} stroke
   * @param {Options} [options]
   */
  ring(id, stroke, options = {}) {
    return this.edit(id, "rings", stroke, options);
  }

  /**
   * Joins the nodes of two rings, each told by one of its curves.
   * @param {string} id
   * @param {number} first
   * @param {number} second
   * @param {MirrorOptions} [options]
   */
  tube(id, first, second, options = {}) {
    return this.edit(id, "tubes", { first, second }, options);
  }

  /**
   * Draws a curve along the surface between two nodes, told by their places in `nodes`.
   * @param {string} id
   * @param {number} first
   * @param {number} second
   * @param {MirrorOptions} [options]
   */
  link(id, first, second, options = {}) {
    return this.edit(id, "links", { first, second }, options);
  }

  /**
   * Makes patches of cells that have not four sides: of all, or of the one that a place lies in.
   * @param {string} id
   * @param {Point} [point]
   * @param {Options} [options]
   */
  fill(id, point, options = {}) {
    return this.edit(id, "fill", point ? { point } : {}, options);
  }

  /**
   * Replaces the curves behind a plane by the mirror images of those before it.
   * @param {string} id
   * @param {Mirror & { radius?: number }} plane
   * @param {Options} [options]
   */
  mirror(id, plane, options = {}) {
    return this.edit(id, "mirror", plane, options);
  }

  /**
   * Draws curves along the creases and boundaries of the mesh.
   * @param {string} id
   * @param {FeatureRequest} [wanted]
   * @param {Options} [options]
   */
  features(id, wanted = {}, options = {}) {
    return this.edit(id, "features", wanted, options);
  }

  /**
   * Marks curves, by their ids, and makes nodes, by their places in `nodes`, corners or none.
   * @param {string} id
   * @param {{ curves?: number[], mark?: CurveMark, nodes?: number[], corner?: boolean }} marks
   * @param {MirrorOptions} [options]
   */
  mark(id, marks, options = {}) {
    return this.edit(id, "marks", marks, options);
  }

  /**
   * Draws a curve by points in space: as a stroke whose points are known already.
   * @param {string} id
   * @param {{ points: Point[], mark?: CurveMark, snap?: number }} curve
   * @param {Options} [options]
   */
  addCurve(id, curve, options = {}) {
    return this.edit(id, "curves", curve, options);
  }

  /**
   * Curves that would bring the layout nearer to completion, for addCurve.
   * @param {string} id
   * @param {MirrorOptions} [options]
   * @returns {Promise<LayoutSuggestion[]>}
   */
  async suggestions(id, { mirror, signal } = {}) {
    const found = await this.layouts.transport.json(`/v1/layouts/${encodeURIComponent(id)}/suggestions${queryOf(mirror)}`, { signal });
    return found.suggestions;
  }

  /**
   * Planes at which the surface of a layout is nearly its own mirror image, the best first.
   * @param {string} id
   * @param {Options} [options]
   * @returns {Promise<SymmetryPlane[]>}
   */
  async symmetry(id, { signal } = {}) {
    const found = await this.layouts.transport.json(`/v1/layouts/${encodeURIComponent(id)}/symmetry`, { signal });
    return found.planes;
  }

  /**
   * Moves the second node onto the first.
   * @param {string} id
   * @param {number} first
   * @param {number} second
   * @param {MirrorOptions} [options]
   */
  mergeNodes(id, first, second, options = {}) {
    return this.edit(id, "nodes/merge", { first, second }, options);
  }

  /**
   * Moves a node to a place of the surface, or to the last point of a stroke.
   * @param {string} id
   * @param {number} node
   * @param {{ point: Point } | Stroke} where
   * @param {MirrorOptions} [options]
   */
  moveNode(id, node, where, options = {}) {
    return this.edit(id, `nodes/${node}/move`, where, options);
  }

  /**
   * Bends a curve between its nodes, by two places or by a stroke from the one to the other.
   * @param {string} id
   * @param {number} curve
   * @param {{ from: Point, to: Point } | Stroke} where
   * @param {MirrorOptions} [options]
   */
  slide(id, curve, where, options = {}) {
    return this.edit(id, `curves/${curve}/slide`, where, options);
  }

  /**
   * Cuts a curve into equal parts, and the whole chord with it.
   * @param {string} id
   * @param {number} curve
   * @param {{ parts?: number }} [wanted]
   * @param {MirrorOptions} [options]
   */
  splitChord(id, curve, wanted = {}, options = {}) {
    return this.edit(id, `curves/${curve}/split-chord`, wanted, options);
  }
}
