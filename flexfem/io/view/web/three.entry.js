// What three.module.min.js holds: three.js 0.187.0 (MIT, see three.LICENSE) as one file.
//
//     npm install three@0.187.0 esbuild@0.25.0
//     npx esbuild three.entry.js --bundle --minify --format=esm --outfile=three.module.min.js
export * from "three";
export { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
