// The parts of three.js that the page and the viewer of reports (evaluate/templates/viewer.js) use. Beside node_modules with
// three@0.187.0 and esbuild@0.28.2, three.min.js is made by
//
//   esbuild three.mjs --bundle --minify --format=esm --legal-comments=none
//     --banner:js="/*! three.js r187. $(cat node_modules/three/LICENSE) */" --outfile=three.min.js
export {
  AnimationClip, AnimationMixer, BackSide, Bone, Box3, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper,
  HemisphereLight, LineBasicMaterial, LineSegments, LoopOnce, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  MeshStandardMaterial, PCFShadowMap, PerspectiveCamera, Plane, PlaneGeometry, Quaternion, QuaternionKeyframeTrack, Raycaster,
  Scene, ShadowMaterial, Skeleton, SkinnedMesh, SphereGeometry, Vector2, Vector3, VectorKeyframeTrack, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
