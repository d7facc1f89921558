// Placements in three dimensions: drag to turn, scroll to come nearer; all models of a page are seen from the same side.
// A page that is opened from disk may not fetch: it loads three.js itself and gives the bytes by `window.modelBytes`.
"use strict";
(() => {
  const stages = [...document.querySelectorAll("[data-model]")];
  const switches = [...document.querySelectorAll("[data-three]")];
  const comparing = document.querySelector("main").dataset.page === "comparison";
  const look = { azimuth: 0.6, elevation: 0.45, distance: 2.4, set: false };
  const viewers = [];
  let library = null;

  function loadLibrary() {
    if (window.THREE) return Promise.resolve();
    library ??= new Promise((resolve, reject) => {
      const script = document.createElement("script");
      script.src = "/three.js";
      script.onload = resolve;
      script.onerror = () => reject(new Error("three.js"));
      document.head.append(script);
    });
    return library;
  }

  async function loadModel(name) {
    const loader = new THREE.GLTFLoader();
    if (!window.modelBytes) return new Promise((resolve, reject) => loader.load(name, resolve, undefined, reject));
    const bytes = await window.modelBytes(name);
    return new Promise((resolve, reject) => loader.parse(bytes, "", resolve, reject));
  }

  // The files' colours are shown as they are stored, as in the pictures.
  function plainMaterial(old, isThing) {
    if (old.map) old.map.encoding = THREE.LinearEncoding;
    return new THREE.MeshLambertMaterial({
      map: old.map || null, color: old.map ? 0xffffff : old.color, vertexColors: old.vertexColors,
      side: isThing ? THREE.DoubleSide : THREE.FrontSide,
    });
  }

  function takeDirection(toward) {
    if (look.set || !toward) return;
    const [x, y, z] = toward;
    look.azimuth = Math.atan2(x, -y);
    look.elevation = Math.asin(Math.max(-1, Math.min(1, z)));
    look.set = true;
  }

  class Viewer {
    constructor(stage) {
      this.stage = stage;
      this.scene = new THREE.Scene();
      this.scene.background = new THREE.Color(0xeef1f4);
      this.camera = new THREE.PerspectiveCamera(40, 1, 0.01, 100);
      this.light = new THREE.DirectionalLight(0xffffff, 0.42);
      this.light.castShadow = true;
      this.light.shadow.mapSize.set(2048, 2048);
      this.scene.add(new THREE.HemisphereLight(0xffffff, 0xa8a298, 0.55), this.light, this.light.target);
      this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
      this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
      this.renderer.shadowMap.enabled = true;
      this.renderer.shadowMap.type = THREE.PCFSoftShadowMap;
      stage.append(this.renderer.domElement);
      this.middle = new THREE.Vector3();
      this.size = 1;
      this.ready = false;
    }

    show(model) {
      let thing = null;
      model.traverse(node => { if (node.name === "object" && !thing) thing = node; });
      const box = new THREE.Box3().setFromObject(thing || model);
      box.getCenter(this.middle);
      this.size = Math.max(box.getSize(new THREE.Vector3()).length(), 1e-3);
      takeDirection(thing && thing.userData.toward);
      const things = new Set();
      (thing || model).traverse(node => things.add(node));
      model.traverse(node => {
        if (!node.isMesh) return;
        if (!node.geometry.attributes.normal) node.geometry.computeVertexNormals();
        node.material = plainMaterial(node.material, things.has(node));
        node.castShadow = node.receiveShadow = true;
      });
      this.scene.add(model);
      this.lightFromAbove();
      this.ready = true;
    }

    // The shadow tells whether the object touches what is below it.
    lightFromAbove() {
      const { size, light, middle } = this, reach = 2.5 * size;
      light.position.copy(middle).add(new THREE.Vector3(0.25 * size, 1.5 * size, 0.2 * size));
      light.target.position.copy(middle);
      Object.assign(light.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.01 * size, far: 8 * size });
      light.shadow.camera.updateProjectionMatrix();
      light.shadow.normalBias = 0.004 * size;
    }

    draw() {
      if (!this.ready || !this.stage.clientWidth) return;
      const { clientWidth: width, clientHeight: height } = this.stage;
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      const away = look.distance * this.size, flat = Math.cos(look.elevation) * away;
      this.camera.near = away / 100;
      this.camera.far = away * 20 + 20;
      const middle = this.shared || this.middle;
      this.camera.position.set(flat * Math.sin(look.azimuth), Math.sin(look.elevation) * away, flat * Math.cos(look.azimuth)).add(middle);
      this.camera.lookAt(middle);
      this.camera.updateProjectionMatrix();
      this.renderer.render(this.scene, this.camera);
      this.stage.dataset.state = "drawn";
    }
  }

  // Objects that are near one another are looked at from the very same place: how high each lies can be compared.
  function shareMiddle() {
    const [first] = viewers;
    const reach = stages.length > 2 ? 0.4 : 1; // of an object's size: of many, none should be at the edge of its picture
    const near = viewers.filter(one => one.middle.distanceTo(first.middle) <= reach * Math.max(one.size, first.size));
    if (near.length < 2) return;
    const size = Math.max(...near.map(one => one.size));
    const shared = near.reduce((sum, one) => sum.add(one.middle), new THREE.Vector3()).divideScalar(near.length);
    for (const one of near) Object.assign(one, { shared, size });
  }

  function drawAll() {
    viewers.forEach(one => one.draw());
  }

  function turn(stage) {
    const fingers = new Map();
    let apart = 0;
    const distance = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y); };
    stage.addEventListener("pointerdown", event => {
      stage.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 2) apart = distance();
    });
    stage.addEventListener("pointermove", event => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
      if (fingers.size === 2) {
        const now = distance();
        nearer(apart / Math.max(now, 1));
        apart = now;
      } else {
        look.azimuth -= (event.clientX - before.x) * 0.008;
        look.elevation = Math.max(-0.35, Math.min(1.5, look.elevation + (event.clientY - before.y) * 0.008));
      }
      drawAll();
    });
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, event => fingers.delete(event.pointerId));
    stage.addEventListener("wheel", event => { event.preventDefault(); nearer(Math.exp(event.deltaY * 0.001)); drawAll(); }, { passive: false });
  }

  function nearer(factor) {
    look.distance = Math.max(0.9, Math.min(9, look.distance * factor));
  }

  function say(stage, words) {
    stage.querySelector("p")?.remove();
    if (words) {
      const line = document.createElement("p");
      line.textContent = words;
      stage.append(line);
    }
  }

  async function open(stage) {
    stage.classList.remove("hidden");
    if (stage.dataset.state) return;
    stage.dataset.state = "loading";
    say(stage, "loading the model …");
    try {
      await loadLibrary();
      const file = await loadModel(stage.dataset.model);
      const viewer = new Viewer(stage);
      viewer.show(file.scene);
      viewers.push(viewer);
      shareMiddle();
      turn(stage);
      say(stage, "");
      drawAll();
    } catch {
      stage.dataset.state = "failed";
      say(stage, "This cannot be shown in 3D here; the pictures show the same.");
    }
  }

  function pictureOf(stage) {
    return stage.parentElement.querySelector(".picture");
  }

  async function show3d() {
    switches.forEach(one => one.setAttribute("aria-pressed", "true"));
    if (comparing) document.querySelectorAll("[data-view]").forEach(one => one.setAttribute("aria-pressed", "false"));
    for (const stage of stages) pictureOf(stage)?.classList.add("hidden");
    for (const stage of stages) await open(stage); // one after the other: the first one chooses the side to look from
    drawAll();
  }

  function showPictures() {
    switches.forEach(one => one.setAttribute("aria-pressed", "false"));
    for (const stage of stages) {
      pictureOf(stage)?.classList.remove("hidden");
      if (pictureOf(stage)) stage.classList.add("hidden");
    }
  }

  switches.forEach(one => one.addEventListener("click", () => (one.getAttribute("aria-pressed") === "true" ? showPictures() : show3d())));
  document.addEventListener("pictures", showPictures);
  window.addEventListener("resize", drawAll);
  stages.filter(stage => !pictureOf(stage)).forEach(open);
})();
