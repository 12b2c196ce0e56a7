// The shapes of requests and replies, as proto/openapi.yaml has them.

/** @typedef {"obj" | "ply" | "stl" | "off" | "glb" | "drc" | "xyz" | "pcd" | "3mf"} Format */
/** @typedef {"triangles" | "bilinear"} QuadReading */
/** @typedef {"two_sided" | "a_to_b" | "b_to_a"} Direction */
/** @typedef {"auto" | "boxes" | "tetra" | "grid"} Accelerator */
/** @typedef {[number, number, number]} Point */
/** @typedef {"queued" | "running" | "succeeded" | "failed" | "canceled"} JobState */

/** @typedef {{ pointer?: string, line?: number, offset?: number, detail: string }} ProblemPlace */
/** @typedef {{ type: string, title: string, status: number, code: string, detail: string, instance?: string,
 *   errors?: ProblemPlace[] }} Problem */

/** @typedef {"um" | "mm" | "cm" | "m" | "in" | "ft"} Unit */
/** @typedef {{ lower: number, upper: number | null, bilinear?: { lower: number, upper: number | null } }} Extent */
/** @typedef {{ id: string, name: string, kind: "triangles" | "quads" | "mixed" | "points", format: Format,
 *   vertices: number, faces: { triangles: number, quads: number, polygons: number }, irregular_vertices: number,
 *   has_normals?: boolean, disc_radius?: number,
 *   patches: number, largest_patch: { rows: number, columns: number } | null, boundary_edges: number,
 *   components: number, manifold: boolean, watertight?: boolean, winding_consistent?: boolean, edges?: number,
 *   boundary_loops?: number, euler_number?: number | null, genus?: number | null, degenerate_faces?: number,
 *   duplicate_faces?: number, area?: Extent | null, volume?: Extent | null, bounding_box: { min: Point, max: Point, diagonal: number },
 *   size_bytes: number, memory_bytes: number, prepare_ms: Record<string, number>, revision: number,
 *   content_hash: string, created: string, expires_at?: string, warnings: string[], unit: Unit | null, uncertainty: number,
 *   labels: string[] }} Mesh */

/** @typedef {{ metric: string, faces: number, undefined: number, minimum: number | null, minimum_face: number | null,
 *   maximum: number | null, maximum_face: number | null, mean: number | null,
 *   percentiles: { percent: number, value: number }[] }} QualitySummary */

/** @typedef {{ rows: number, columns: number, faces: number[] }} Patch */
/** @typedef {{ patch_count: number, irregular_vertices: number, patches: Patch[] }} Patches */

/** Sixteen numbers, column by column. @typedef {number[]} Transform */
/** A mesh where it lies, or moved for one job. @typedef {string | { mesh: string, transform: Transform }} MeshName */

/** What the engine alone is told: how it searches, and what it may use. Most do well without; a kind of job takes those that it has,
 * which stood beside `engine` before.
 * @typedef {{ accelerator?: Accelerator, bounds?: "cover" | "matching", memory_limit?: number, pieces?: number }} Engine */
/** @typedef {{ quads?: QuadReading, threads?: number, engine?: Engine, accelerator?: Accelerator, detach?: boolean,
 *   labels?: string[] | null }} CommonRequest */
/** How closely an interval is searched; `tolerance` and `tolerance_unit` are the former names.
 * @typedef {{ gap?: number, gap_unit?: "relative" | "absolute", tolerance?: number,
 *   tolerance_unit?: "relative" | "absolute" }} Gap */
/** `threshold` is the former name of `limit`.
 * @typedef {CommonRequest & Gap & { type: "hausdorff", a: MeshName, b: MeshName, direction?: Direction,
 *   limit?: number | null, threshold?: number | null, deadline_ms?: number, memory_limit?: number,
 *   bounds?: "cover" | "matching" }} HausdorffRequest */
/** @typedef {CommonRequest & { type: "project", mesh: MeshName, points: Point[] }} ProjectRequest */
/** @typedef {CommonRequest & Gap & { type: "deviation", a: MeshName, b: MeshName, accuracy?: number, pieces?: number,
 *   percentiles?: number[], bins?: number, limit?: number | null, regions?: boolean,
 *   sign?: "none" | "outside" | "inside" | "normal", bands?: [number | null, number | null][] }} DeviationRequest */
/** @typedef {CommonRequest & Gap & { type: "comparison", a: MeshName, b: MeshName, limits?: number[], percentiles?: number[],
 *   accuracy?: number, pieces?: number, worst?: { count: number, radius?: number } | null, limit?: number | null, regions?: boolean,
 *   sign?: "none" | "outside" | "inside" | "normal", bands?: [number | null, number | null][] }} ComparisonRequest */
/** @typedef {CommonRequest & Gap & { type: "distance", a: MeshName, b: MeshName, limit?: number | null }} DistanceRequest */
/** @typedef {CommonRequest & Gap & { mode?: "all" | "first" | "any", limit?: number }} AnyCollisionRequest */
/** @typedef {AnyCollisionRequest & { type: "collision", a: MeshName, b: MeshName, solid?: boolean,
 *   penetration?: boolean }} CollisionRequest */
/** @typedef {AnyCollisionRequest & { type: "self_collision", mesh: MeshName, incremental?: boolean }} SelfCollisionRequest */
/** @typedef {Gap & { type: "alignment", a: MeshName, b: MeshName, fit?: "least_squares" | "min_max",
 *   start?: "principal" | "centroids" | "identity" | "landmarks", motion?: "rigid" | "rigid_scale" | "translation",
 *   direction?: "auto" | Direction, landmarks?: [Point, Point][], trim?: number, max_distance?: number | null, mirror?: boolean,
 *   samples?: number, quads?: QuadReading, threads?: number,
 *   detach?: boolean }} AlignmentRequest */
/** @typedef {CommonRequest & { type: "heatmap", a: MeshName, b: MeshName, error?: number, pieces?: number }} HeatmapRequest */
/** @typedef {"all" | { nearest: number } | { within: number }} MatrixWant */
/** @typedef {Gap & { type: "matrix", meshes: MeshName[], want?: MatrixWant, measure?: "hausdorff", quads?: QuadReading,
 *   threads?: number, detach?: boolean, deadline_ms?: number }} MatrixRequest */
/** @typedef {{ type: "reconstruction_step", reconstruction: string, steps?: number, measure?: boolean, threads?: number,
 *   until?: { hausdorff_relative?: number, max_quads?: number, edge_length?: number }, settle?: boolean,
 *   detach?: boolean }} StepRequest */
/** @typedef {{ type: "remesh", mesh: MeshName, quads?: number, distance?: number, semi_regular?: boolean, crease_angle?: number,
 *   threads?: number, detach?: boolean, deadline_ms?: number }} RemeshRequest */
/** @typedef {HausdorffRequest | ProjectRequest | DeviationRequest | ComparisonRequest | HeatmapRequest | DistanceRequest
 *   | CollisionRequest | SelfCollisionRequest | AlignmentRequest | MatrixRequest | StepRequest | RemeshRequest} JobRequest */

/** @typedef {{ elapsed_ms: number, lower: number, upper: number | null, lower_relative: number | null,
 *   upper_relative: number | null, gap_relative: number | null, iterations: number, projections: number,
 *   queue: number }} Bounds */
/** @typedef {{ mesh: "a" | "b", id: string, face: number, uv: [number, number], point: Point }} SurfacePoint */
/** Two points of two meshes. @typedef {{ from: SurfacePoint, to: SurfacePoint }} Witness */
/** @typedef {{ lower: number, upper: number | null, lower_relative: number | null, upper_relative: number | null,
 *   witness?: Witness, direction: Direction, quads: QuadReading, gap: number,
 *   iterations: number, projections: number, max_queue: number, prepare_ms: { a: number, b: number },
 *   elapsed_ms: number, converged: boolean,
 *   stopped_by: "converged" | "limit" | "deadline" | "canceled" | "precision" | "work" | "memory",
 *   verdict: "above" | "below" | null, of_true?: TrueInterval, warnings?: string[] }} HausdorffResult */
/** @typedef {{ distance: number, distance_relative: number | null, point: Point, face: number, patch?: number,
 *   uv: [number, number] }} Foot */
/** @typedef {{ quads: QuadReading, point_count: number, points: Foot[], prepare_ms: number,
 *   elapsed_ms: number }} ProjectResult */
/** @typedef {{ lower: number, upper: number }} Interval */
/** @typedef {{ lower: number, upper: number | null, lower_relative: number | null, upper_relative: number | null }} TrueInterval */
/** @typedef {Interval & { lower_relative: number | null, upper_relative: number | null, of_true?: TrueInterval }} LengthInterval */
/** @typedef {{ max: LengthInterval, size: Interval,
 *   witness?: Witness }} DeviationSide */
/** @typedef {{ sign: "outside" | "inside" | "normal", proven: boolean, mean: Interval, outside: DeviationSide,
 *   inside: DeviationSide, open_size: number, bands: (Interval & { from: number | null, to: number | null })[] }} SignedDeviation */
/** @typedef {{ surely: boolean, parts: number, area: Interval, max: LengthInterval,
 *   witness?: Witness, centroid: Point, box: { min: Point, max: Point },
 *   face_count: number, faces: number[] }} DeviationRegion */
/** @typedef {{ over: "area" | "vertices" | "points", size: Interval, mean: LengthInterval, rms: LengthInterval,
 *   max: LengthInterval, percentiles: (LengthInterval & { percent: number })[],
 *   histogram: { bin_width: number, shares: [number, number][] }, signed?: SignedDeviation,
 *   verdict?: "above" | "below" | null, region_count?: number, regions?: DeviationRegion[], vertex_count: number, vertex_distances?: number[],
 *   warnings?: string[], quads: QuadReading, accuracy: number, gap: number, accurate: boolean, pieces: number, projections: number,
 *   prepare_ms: { a: number, b: number }, elapsed_ms: number }} DeviationResult */
/** One direction of a comparison: of the points of one surface from the other one.
 * @typedef {{ over: "area" | "vertices" | "points", size: Interval, hausdorff: LengthInterval, mean: LengthInterval,
 *   rms: LengthInterval, std: LengthInterval, percentiles: (LengthInterval & { percent: number })[],
 *   shares: (Interval & { limit: number })[], witness?: Witness, worst?: (LengthInterval & Witness)[],
 *   signed?: SignedDeviation, unsigned?: "empty" | "open" | "turned" | "crossing" | "canceled",
 *   verdict?: "above" | "below" | null, region_count?: number, regions?: DeviationRegion[],
 *   accurate: boolean }} ComparisonDirection */
/** @typedef {{ limit: number, precision: Interval, recall: Interval, f: Interval }} FScore */
/** @typedef {{ a_to_b: ComparisonDirection, b_to_a: ComparisonDirection,
 *   symmetric: { hausdorff: LengthInterval, hd95: LengthInterval, mean: LengthInterval, rms: LengthInterval,
 *     chamfer: { l1: Interval, l1_half: Interval, l2: Interval, l2_half: Interval }, f_score: FScore[] },
 *   quads: QuadReading, accuracy: number, gap: number, accurate: boolean, pieces: number, projections: number,
 *   prepare_ms: { a: number, b: number }, elapsed_ms: number, warnings?: string[] }} ComparisonResult */
/** Fourteen numbers a triangle: x, y, z and distance of each corner, the face, the error.
 * @typedef {{ count: number, error: number, requested_error: number, accurate: boolean, triangles?: number[][], quads: QuadReading,
 *   prepare_ms: { a: number, b: number }, elapsed_ms: number }} HeatmapResult */
/** @typedef {{ lower: number, upper: number, lower_relative: number | null, upper_relative: number | null,
 *   witness: Witness, collides: boolean, verdict: "above" | "below" | null, quads: QuadReading, gap: number,
 *   converged: boolean, face_pairs: number, prepare_ms: { a: number, b: number }, elapsed_ms: number, of_true?: TrueInterval,
 *   warnings?: string[] }} DistanceResult */
/** @typedef {{ faces: [number, number], contact: "point" | "segment" | "area", points: Point[],
 *   normals: [Point, Point] }} CollisionPair */
/** How deep a solid is in the other. @typedef {LengthInterval & { witness?: Witness }} Depth */
/** @typedef {{ collides: boolean, count: number, pairs: CollisionPair[], all_pairs?: [number, number][],
 *   mode: "all" | "first" | "any", quads: QuadReading, tests: number, elapsed_ms: number,
 *   relation?: "meeting" | "apart" | "a_inside_b" | "b_inside_a" | "overlapping",
 *   penetration?: { a_in_b: Depth, b_in_a: Depth }, warnings?: string[], incremental?: boolean }} CollisionResult */
/** A pair of meshes by their places, with the bounds of its distance. @typedef {[number, number, number, number | null]} PairRow */
/** @typedef {{ within: number, beyond: number, undecided: number }} Verdicts */
/** @typedef {{ measure: "hausdorff", mesh_count: number, meshes: MeshName[], pair_count: number, searched_pairs: number,
 *   bounded_pairs: number, searches: number, pivots: number, want: MatrixWant,
 *   nearest?: ({ mesh: number, lower: number, upper: number | null, place: "proven" | "tied" | "open",
 *     of_true?: TrueInterval })[][],
 *   verdicts?: Verdicts & { of_true?: Verdicts }, uncertainties?: number[], open: number, pairs?: PairRow[],
 *   quads: QuadReading, gap: number, converged: boolean,
 *   stopped_by: "converged" | "precision" | "deadline" | "canceled", elapsed_ms: number }} MatrixResult */
/** @typedef {{ folded_quads: number, turned_quads: number, least_jacobian: number, mean_angle_deviation_deg: number,
 *   max_angle_deviation_deg: number, mean_edge_ratio: number, max_edge_ratio: number, mean_warp: number,
 *   max_warp: number }} QuadQuality */
/** @typedef {{ step: number, quads: number, chords_doubled: number, patches_split: number, moved_vertices: number,
 *   holes_filled: number, longest_edge: number, quality: QuadQuality, hausdorff: LengthInterval | null, covered?: LengthInterval,
 *   mesh_to_points?: LengthInterval, uncovered_points?: number, beyond_points?: number, step_ms: number, measure_ms: number }} StepRecord */
/** @typedef {{ kept: boolean, quality: QuadQuality, hausdorff: LengthInterval, from_surface: LengthInterval,
 *   from_quads: LengthInterval }} Settled */
/** @typedef {{ reconstruction: string, mesh: string, quads: number, step_count: number,
 *   stopped_by: "steps" | "max_quads" | "edge_length" | "hausdorff" | "canceled", steps: StepRecord[], settled?: Settled,
 *   elapsed_ms: number }} StepResult */
/** @typedef {{ mesh: string, quads: number, irregular_vertices: number, components: number, patches?: number,
 *   patches_from?: "layout" | "division" | "quads", folded: number,
 *   least_scaled_jacobian: number, hausdorff: LengthInterval, from_surface: LengthInterval, from_quads: LengthInterval,
 *   reached?: boolean, points?: SurfaceOfPoints, rounds: number, prepare_ms: number, elapsed_ms: number }} RemeshResult */
/** @typedef {{ used: number, outliers: number, noise_relative: number, spacing_relative: number, normals: "given" | "estimated",
 *   holes_filled: number, filled_share: number, thin_share: number, borders: number, hausdorff: LengthInterval }} SurfaceOfPoints */
/** @typedef {{ transform: Transform, rms: number, scale: number, mirrored: boolean, floor: number | null,
 *   certainty: { runner_up_rms: number | null }, hausdorff: LengthInterval & { converged: boolean },
 *   fit: "least_squares" | "min_max", quads: QuadReading, gap: number, iterations: number, rounds: number,
 *   converged: boolean, prepare_ms: { a: number, b: number }, elapsed_ms: number }} AlignmentResult */
/** @typedef {HausdorffResult | ProjectResult | DeviationResult | ComparisonResult | HeatmapResult | DistanceResult | CollisionResult
 *   | AlignmentResult | MatrixResult | StepResult | RemeshResult} JobResult */

/** @typedef {"smooth" | "sharp" | "fixed"} CurveMark */
/** @typedef {{ id: number, from: number, to: number, mark?: CurveMark, points: Point[] }} Curve */
/** @typedef {{ angle_deg?: number, shortest?: number, snap?: number }} FeatureRequest */
/** @typedef {{ mesh: string, nodes?: Point[], corners?: number[], curves?: Curve[], patches?: number[][],
 *   features?: FeatureRequest }} LayoutRequest */
/** @typedef {{ mesh: string, quads: string, patches?: number, features?: { angle_deg?: number }, crease_angle?: number,
 *   deadline_ms?: number }} QuadLayoutRequest */
/** @typedef {{ mesh: string, auto: true, quad_count?: number, patches?: number, features?: { angle_deg?: number },
 *   crease_angle?: number, symmetry?: "found" | Mirror, deadline_ms?: number }} AutoLayoutRequest */
/** @typedef {{ id: string, mesh: string, revision: number, can_undo: boolean, can_redo: boolean, complete: boolean,
 *   created: string }} LayoutBrief */
/** @typedef {{ kind: "dangling_end" | "cell_sides" | "apart" | "crossing", curve: number, other_curve?: number, node?: number,
 *   sides?: number, point: Point, detail: string }} LayoutIssue */
/** @typedef {LayoutBrief & { nodes: Point[], corners?: number[], curves: Curve[], patches: number[][],
 *   issues: LayoutIssue[] }} Layout */
/** @typedef {Layout & { changed: { added_curves: number[], changed_curves: number[], removed_curves: number[] },
 *   filled_cells?: number, added_features?: number, mirrored?: boolean, stroke?: { curve: number, points: number, missed_points: number } }} EditedLayout */
/** @typedef {{ kind: "feature" | "end" | "join" | "divide" | "image", points: Point[], mark?: CurveMark, detail: string }} LayoutSuggestion */
/** @typedef {{ angle_deg?: number, reach?: number }} FeatureSnap */
/** @typedef {{ point: Point, normal: Point }} Mirror a plane */
/** @typedef {Mirror & { distance: { lower: number, upper: number } }} SymmetryPlane */
/** @typedef {{ points: [number, number][], view: number[], projection: number[], viewport: number[], radius_px?: number,
 *   depth?: number, snap?: number, features?: FeatureSnap, mirror?: Mirror }} Stroke */
/** @typedef {"automatic" | number} Noise of points, as a fraction of the diagonal */
/** @typedef {{ layout: string, source?: string, cover_share?: number, pull_curves?: boolean, noise?: Noise,
 *   deadline_ms?: number }} ReconstructionRequest */
/** @typedef {{ id: string, source: string, layout: string, patch_count: number, cover_share: number,
 *   pull_curves: boolean, noise?: Noise, coverage: { samples: number, uncovered_samples: number }, created: string, mesh: string,
 *   quads: number, step_count: number, revision: number, warnings?: ReconstructionWarning[] }} ReconstructionBrief */
/** @typedef {{ kind: "spans_hole" | "uncovered" | "one_sided" | "inside_out" | "noise" | "outliers" | "estimated_normals" |
 *   "fills_hole", patch?: number, share?: number,
 *   detail: string }} ReconstructionWarning */
/** @typedef {ReconstructionBrief & { steps: StepRecord[] }} Reconstruction */
/** @typedef {{ quads: number, patches: { patch: number, first_face: number, columns: number, rows: number,
 *   samples: number }[] }} ReconstructionPatches */

/** @typedef {{ id: string, type: string, state: JobState, created: string, started?: string, ended?: string,
 *   request: Record<string, any> & { type: string }, progress?: Bounds | Stage, result?: JobResult, problem?: Problem,
 *   cached?: true, labels: string[] }} Job */

/** @typedef {Bounds & { event: "bounds", seq: number }} BoundsEvent */
/** @typedef {{ event: "result", seq: number, state: "succeeded" | "canceled", result: JobResult }} ResultEvent */
/** @typedef {{ event: "error", seq: number, state: "failed" | "canceled", problem: Problem }} ErrorEvent */
/** @typedef {StepRecord & { event: "step", seq: number }} StepEvent */
/** @typedef {{ event: "pairs", seq: number, elapsed_ms: number, pair_count: number, searched_pairs: number,
 *   bounded_pairs: number, searches: number, pairs: PairRow[] }} PairsEvent */
/** @typedef {{ elapsed_ms: number, stage: "surface" | "quads" | "layout" | "fill" | "measure", quads: number,
 *   hausdorff?: LengthInterval }} Stage */
/** @typedef {Stage & { event: "stage", seq: number }} StageEvent */
/** @typedef {BoundsEvent | StepEvent | StageEvent | PairsEvent | ResultEvent | ErrorEvent} JobEvent */

/** @typedef {{ key: string | number | null, line: number, state: "succeeded" | "failed" | "canceled",
 *   cached?: true, result?: JobResult, problem?: Problem }} BatchAnswer */

/** @typedef {{ name: string, version: string, kernel: string, formats: Format[], jobs: string[],
 *   accelerators: Accelerator[], limits: { body_bytes: number, data_bytes: number,
 *   memory_bytes: number, faces: number, queued_jobs: number,
 *   connections: number, streams: number }, workers: number, queued: number, running: number,
 *   data_bytes: number }} Info */

export {};
