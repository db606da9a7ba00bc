// What the viewer's components share: tracks and voxels from the server, geometry, the clock.
export { openTrack, openVoxels, overview } from "./tracks.js";
export { APART, BONES, OTHER_SIDE, compose, facing, headOf, hipsOf, linesOf, matchSeconds, poseAt, setBody } from "./figures.js";
export { player } from "./player.js";
export { StickCanvas, strip } from "./sticks.js";
export { fill, save, setAddress } from "./page.js";
