// The worker that builds trees for picking, away from the page. Workers have no import map: the vendor copies are named as they
// lie.

import { BufferAttribute, BufferGeometry } from "/dashboard/vendor/three.module.js";
import { MeshBVH } from "/dashboard/vendor/mesh-bvh.js";

self.addEventListener("message", ({ data: { request, position } }) => {
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  // Indirect: the triangles keep their order, which other attributes follow.
  const tree = MeshBVH.serialize(new MeshBVH(geometry, { indirect: true }), { cloneBuffers: false });
  const buffers = [...tree.roots, /** @type {any} */ (tree).indirectBuffer.buffer];
  /** @type {any} */ (self).postMessage({ request, tree }, buffers);
});
