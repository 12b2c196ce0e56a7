// Two points that are farthest apart, and which of them has to be seen.

/** @import { Point, Witness } from "../../js/types.js" */

/** That on A first: B is a ghost over A, or hidden, so that a point of B within A is seen from nowhere. @param {Witness} witness @returns {[Point, Point]} */
export const aFirst = ({ from, to }) => (from.mesh === "a" ? [from.point, to.point] : [to.point, from.point]);
