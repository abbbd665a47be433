// The parts of three.js that viewer.js uses. Beside node_modules with three@0.187.0 and esbuild@0.28.2, three.min.js is made by
//
//   esbuild three.mjs --bundle --minify --format=iife --global-name=THREE --legal-comments=none
//     --banner:js="/*! three.js r187. $(cat node_modules/three/LICENSE) */" --outfile=three.min.js
export {
  BackSide, Bone, BufferAttribute, BufferGeometry, Color, DirectionalLight, GridHelper, HemisphereLight, Matrix4, Mesh,
  MeshLambertMaterial, PerspectiveCamera, Scene, Skeleton, SkinnedMesh, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
