var ji={LEFT:0,MIDDLE:1,RIGHT:2,ROTATE:0,DOLLY:1,PAN:2},Zi={ROTATE:0,PAN:1,DOLLY_PAN:2,DOLLY_ROTATE:3},Bf=0,Yh=1,zf=2;var bs=1,Hf=2,yr=3,ei=0,Kt=1,It=2,Ms=0,vr=1,Kh=2,jh=3,Zh=4,Gf=5;var ws=100,Vf=101,Wf=102,Xf=103,qf=104,$f=200,Yf=201,Kf=202,jf=203,Jh=204,Qh=205,Zf=206,Jf=207,Qf=208,ep=209,tp=210,np=211,ip=212,sp=213,rp=214,Ca=0,nr=1,Pa=2,ir=3,Ia=4,La=5,Da=6,Na=7,Ja=0,op=1,ap=2,ti=0,eu=1,tu=2,nu=3,iu=4,su=5,ru=6,bo=7,Oh="attached",lp="detached",ou=300,Ss=301,_r=302,Qa=303,el=304,zi=1e3,Cn=1001,Hi=1002,gt=1003,tl=1004;var Ts=1005;var St=1006,br=1007;var Ln=1008;var pn=1009,au=1010,lu=1011,Mr=1012,nl=1013,Vn=1014,_n=1015,bn=1016,il=1017,sl=1018,As=1020,cu=35902,hu=35899,uu=1021,du=1022,Dn=1023,xi=1026,Ei=1027,rl=1028,ol=1029,Ji=1030,al=1031;var ll=1033,Mo=33776,wo=33777,So=33778,To=33779,cl=35840,hl=35841,ul=35842,dl=35843,fl=36196,pl=37492,ml=37496,gl=37488,xl=37489,Ao=37490,yl=37491,vl=37808,_l=37809,bl=37810,Ml=37811,wl=37812,Sl=37813,Tl=37814,Al=37815,El=37816,Rl=37817,Cl=37818,Pl=37819,Il=37820,Ll=37821,Dl=36492,Nl=36494,Ol=36495,Ul=36283,Fl=36284,Eo=36285,kl=36286;var us=2300,ds=2301,Ea=2302,Uh=2303,Fh=2400,kh=2401,Bh=2402,cp=2500;var fu=0,Ro=1,wr=2,hp=3200;var Co=0,up=1,Wn="",ot="srgb",an="srgb-linear",jr="linear",nt="srgb";var Ra=7680;var dp=519,fp=512,pp=513,mp=514,pu=515,gp=516,xp=517,mu=518,gu=519,xu=35044;var yu="300 es",Pn=2e3,sr=2001;function a0(s){for(let e=s.length-1;e>=0;--e)if(s[e]>=65535)return!0;return!1}function l0(s){return ArrayBuffer.isView(s)&&!(s instanceof DataView)}function rr(s){return document.createElementNS("http://www.w3.org/1999/xhtml",s)}function yp(){let s=rr("canvas");return s.style.display="block",s}var $d={},or=null;function Zr(...s){let e="THREE."+s.shift();or?or("log",e,...s):console.log(e,...s)}function vp(s){let e=s[0];if(typeof e=="string"&&e.startsWith("TSL:")){let t=s[1];t&&t.isStackTrace?s[0]+=" "+t.getLocation():s[1]='Stack trace not available. Enable "THREE.Node.captureStackTrace" to capture stack traces.'}return s}function Ee(...s){s=vp(s);let e="THREE."+s.shift();if(or)or("warn",e,...s);else{let t=s[0];t&&t.isStackTrace?console.warn(t.getError(e)):console.warn(e,...s)}}function Oe(...s){s=vp(s);let e="THREE."+s.shift();if(or)or("error",e,...s);else{let t=s[0];t&&t.isStackTrace?console.error(t.getError(e)):console.error(e,...s)}}function hs(...s){let e=s.join(" ");e in $d||($d[e]=!0,Ee(...s))}function _p(s,e,t){return new Promise(function(n,i){function r(){switch(s.clientWaitSync(e,s.SYNC_FLUSH_COMMANDS_BIT,0)){case s.WAIT_FAILED:i();break;case s.TIMEOUT_EXPIRED:setTimeout(r,t);break;default:n()}}setTimeout(r,t)})}var bp={[Ca]:Ca,[Pa]:Da,[Ia]:Ia,[ir]:La,[nr]:nr,[Da]:Pa,[Na]:Na,[La]:ir},Bn=class{addEventListener(e,t){this._listeners===void 0&&(this._listeners={});let n=this._listeners;n[e]===void 0&&(n[e]=[]),n[e].indexOf(t)===-1&&n[e].push(t)}hasEventListener(e,t){let n=this._listeners;return n===void 0?!1:n[e]!==void 0&&n[e].indexOf(t)!==-1}removeEventListener(e,t){let n=this._listeners;if(n===void 0)return;let i=n[e];if(i!==void 0){let r=i.indexOf(t);r!==-1&&i.splice(r,1)}}dispatchEvent(e){let t=this._listeners;if(t===void 0)return;let n=t[e.type];if(n!==void 0){e.target=this;let i=n.slice(0);for(let r=0,o=i.length;r<o;r++)i[r].call(this,e);e.target=null}}},Qt=["00","01","02","03","04","05","06","07","08","09","0a","0b","0c","0d","0e","0f","10","11","12","13","14","15","16","17","18","19","1a","1b","1c","1d","1e","1f","20","21","22","23","24","25","26","27","28","29","2a","2b","2c","2d","2e","2f","30","31","32","33","34","35","36","37","38","39","3a","3b","3c","3d","3e","3f","40","41","42","43","44","45","46","47","48","49","4a","4b","4c","4d","4e","4f","50","51","52","53","54","55","56","57","58","59","5a","5b","5c","5d","5e","5f","60","61","62","63","64","65","66","67","68","69","6a","6b","6c","6d","6e","6f","70","71","72","73","74","75","76","77","78","79","7a","7b","7c","7d","7e","7f","80","81","82","83","84","85","86","87","88","89","8a","8b","8c","8d","8e","8f","90","91","92","93","94","95","96","97","98","99","9a","9b","9c","9d","9e","9f","a0","a1","a2","a3","a4","a5","a6","a7","a8","a9","aa","ab","ac","ad","ae","af","b0","b1","b2","b3","b4","b5","b6","b7","b8","b9","ba","bb","bc","bd","be","bf","c0","c1","c2","c3","c4","c5","c6","c7","c8","c9","ca","cb","cc","cd","ce","cf","d0","d1","d2","d3","d4","d5","d6","d7","d8","d9","da","db","dc","dd","de","df","e0","e1","e2","e3","e4","e5","e6","e7","e8","e9","ea","eb","ec","ed","ee","ef","f0","f1","f2","f3","f4","f5","f6","f7","f8","f9","fa","fb","fc","fd","fe","ff"],Yd=1234567,er=Math.PI/180,fs=180/Math.PI;function ni(){let s=Math.random()*4294967295|0,e=Math.random()*4294967295|0,t=Math.random()*4294967295|0,n=Math.random()*4294967295|0;return(Qt[s&255]+Qt[s>>8&255]+Qt[s>>16&255]+Qt[s>>24&255]+"-"+Qt[e&255]+Qt[e>>8&255]+"-"+Qt[e>>16&15|64]+Qt[e>>24&255]+"-"+Qt[t&63|128]+Qt[t>>8&255]+"-"+Qt[t>>16&255]+Qt[t>>24&255]+Qt[n&255]+Qt[n>>8&255]+Qt[n>>16&255]+Qt[n>>24&255]).toLowerCase()}function qe(s,e,t){return Math.max(e,Math.min(t,s))}function vu(s,e){return(s%e+e)%e}function c0(s,e,t,n,i){return n+(s-e)*(i-n)/(t-e)}function h0(s,e,t){return s!==e?(t-s)/(e-s):0}function Kr(s,e,t){return(1-t)*s+t*e}function u0(s,e,t,n){return Kr(s,e,1-Math.exp(-t*n))}function d0(s,e=1){return e-Math.abs(vu(s,e*2)-e)}function f0(s,e,t){return s<=e?0:s>=t?1:(s=(s-e)/(t-e),s*s*(3-2*s))}function p0(s,e,t){return s<=e?0:s>=t?1:(s=(s-e)/(t-e),s*s*s*(s*(s*6-15)+10))}function m0(s,e){return s+Math.floor(Math.random()*(e-s+1))}function g0(s,e){return s+Math.random()*(e-s)}function x0(s){return s*(.5-Math.random())}function y0(s){s!==void 0&&(Yd=s);let e=Yd+=1831565813;return e=Math.imul(e^e>>>15,e|1),e^=e+Math.imul(e^e>>>7,e|61),((e^e>>>14)>>>0)/4294967296}function v0(s){return s*er}function _0(s){return s*fs}function b0(s){return s>0&&Number.isInteger(s)&&2**Math.round(Math.log2(s))===s}function M0(s){return Math.pow(2,Math.ceil(Math.log(s)/Math.LN2))}function _u(s){return Math.pow(2,Math.floor(Math.log(s)/Math.LN2))}function w0(s,e,t,n,i){let r=Math.cos,o=Math.sin,a=r(t/2),l=o(t/2),c=r((e+n)/2),h=o((e+n)/2),u=r((e-n)/2),d=o((e-n)/2),f=r((n-e)/2),g=o((n-e)/2);switch(i){case"XYX":s.set(a*h,l*u,l*d,a*c);break;case"YZY":s.set(l*d,a*h,l*u,a*c);break;case"ZXZ":s.set(l*u,l*d,a*h,a*c);break;case"XZX":s.set(a*h,l*g,l*f,a*c);break;case"YXY":s.set(l*f,a*h,l*g,a*c);break;case"ZYZ":s.set(l*g,l*f,a*h,a*c);break;default:Ee("MathUtils: .setQuaternionFromProperEuler() encountered an unknown order: "+i)}}function Bl(s){switch(s.constructor){case Uint32Array:return 4294967295;case Uint16Array:return 65535;case Uint8Array:case Uint8ClampedArray:return 255;case Int32Array:return 2147483647;case Int16Array:return 32767;case Int8Array:return 127;default:return}}function bu(s,e){if(e.constructor===Float32Array)return s;let t=Bl(e);if(t===void 0)throw new Error("THREE.MathUtils: Invalid component type.");return Math.max(s/t,-1)}function Mu(s,e){if(e.constructor===Float32Array)return s;let t=Bl(e);if(t===void 0)throw new Error("THREE.MathUtils: Invalid component type.");return Math.round(s*t)}var Ri={DEG2RAD:er,RAD2DEG:fs,generateUUID:ni,clamp:qe,euclideanModulo:vu,mapLinear:c0,inverseLerp:h0,lerp:Kr,damp:u0,pingpong:d0,smoothstep:f0,smootherstep:p0,randInt:m0,randFloat:g0,randFloatSpread:x0,seededRandom:y0,degToRad:v0,radToDeg:_0,isPowerOfTwo:b0,ceilPowerOfTwo:M0,floorPowerOfTwo:_u,setQuaternionFromProperEuler:w0,normalize:Mu,denormalize:bu},ye=class{static{this.prototype.isVector2=!0}constructor(e=0,t=0){this.x=e,this.y=t}get width(){return this.x}set width(e){this.x=e}get height(){return this.y}set height(e){this.y=e}set(e,t){return this.x=e,this.y=t,this}setScalar(e){return this.x=e,this.y=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;default:throw new Error("THREE.Vector2: index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;default:throw new Error("THREE.Vector2: index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y)}copy(e){return this.x=e.x,this.y=e.y,this}add(e){return this.x+=e.x,this.y+=e.y,this}addScalar(e){return this.x+=e,this.y+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this}subScalar(e){return this.x-=e,this.y-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this}multiply(e){return this.x*=e.x,this.y*=e.y,this}multiplyScalar(e){return this.x*=e,this.y*=e,this}divide(e){return this.x/=e.x,this.y/=e.y,this}divideScalar(e){return this.multiplyScalar(1/e)}applyMatrix3(e){let t=this.x,n=this.y,i=e.elements;return this.x=i[0]*t+i[3]*n+i[6],this.y=i[1]*t+i[4]*n+i[7],this}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this}clamp(e,t){return this.x=qe(this.x,e.x,t.x),this.y=qe(this.y,e.y,t.y),this}clampScalar(e,t){return this.x=qe(this.x,e,t),this.y=qe(this.y,e,t),this}clampLength(e,t){let n=this.length();return this.divideScalar(n||1).multiplyScalar(qe(n,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this}negate(){return this.x=-this.x,this.y=-this.y,this}dot(e){return this.x*e.x+this.y*e.y}cross(e){return this.x*e.y-this.y*e.x}lengthSq(){return this.x*this.x+this.y*this.y}length(){return Math.sqrt(this.x*this.x+this.y*this.y)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)}normalize(){return this.divideScalar(this.length()||1)}angle(){return Math.atan2(-this.y,-this.x)+Math.PI}angleTo(e){let t=Math.sqrt(this.lengthSq()*e.lengthSq());if(t===0)return Math.PI/2;let n=this.dot(e)/t;return Math.acos(qe(n,-1,1))}distanceTo(e){return Math.sqrt(this.distanceToSquared(e))}distanceToSquared(e){let t=this.x-e.x,n=this.y-e.y;return t*t+n*n}manhattanDistanceTo(e){return Math.abs(this.x-e.x)+Math.abs(this.y-e.y)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this}lerpVectors(e,t,n){return this.x=e.x+(t.x-e.x)*n,this.y=e.y+(t.y-e.y)*n,this}equals(e){return e.x===this.x&&e.y===this.y}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this}rotateAround(e,t){let n=Math.cos(t),i=Math.sin(t),r=this.x-e.x,o=this.y-e.y;return this.x=r*n-o*i+e.x,this.y=r*i+o*n+e.y,this}random(){return this.x=Math.random(),this.y=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y}},De=class{constructor(e=0,t=0,n=0,i=1){this.isQuaternion=!0,this._x=e,this._y=t,this._z=n,this._w=i}static slerpFlat(e,t,n,i,r,o,a){let l=n[i+0],c=n[i+1],h=n[i+2],u=n[i+3],d=r[o+0],f=r[o+1],g=r[o+2],y=r[o+3];if(u!==y||l!==d||c!==f||h!==g){let p=l*d+c*f+h*g+u*y;p<0&&(d=-d,f=-f,g=-g,y=-y,p=-p);let m=1-a;if(p<.9995){let b=Math.acos(p),E=Math.sin(b);m=Math.sin(m*b)/E,a=Math.sin(a*b)/E,l=l*m+d*a,c=c*m+f*a,h=h*m+g*a,u=u*m+y*a}else{l=l*m+d*a,c=c*m+f*a,h=h*m+g*a,u=u*m+y*a;let b=1/Math.sqrt(l*l+c*c+h*h+u*u);l*=b,c*=b,h*=b,u*=b}}e[t]=l,e[t+1]=c,e[t+2]=h,e[t+3]=u}static multiplyQuaternionsFlat(e,t,n,i,r,o){let a=n[i],l=n[i+1],c=n[i+2],h=n[i+3],u=r[o],d=r[o+1],f=r[o+2],g=r[o+3];return e[t]=a*g+h*u+l*f-c*d,e[t+1]=l*g+h*d+c*u-a*f,e[t+2]=c*g+h*f+a*d-l*u,e[t+3]=h*g-a*u-l*d-c*f,e}get x(){return this._x}set x(e){this._x=e,this._onChangeCallback()}get y(){return this._y}set y(e){this._y=e,this._onChangeCallback()}get z(){return this._z}set z(e){this._z=e,this._onChangeCallback()}get w(){return this._w}set w(e){this._w=e,this._onChangeCallback()}set(e,t,n,i){return this._x=e,this._y=t,this._z=n,this._w=i,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._w)}copy(e){return this._x=e.x,this._y=e.y,this._z=e.z,this._w=e.w,this._onChangeCallback(),this}setFromEuler(e,t=!0){let n=e._x,i=e._y,r=e._z,o=e._order,a=Math.cos,l=Math.sin,c=a(n/2),h=a(i/2),u=a(r/2),d=l(n/2),f=l(i/2),g=l(r/2);switch(o){case"XYZ":this._x=d*h*u+c*f*g,this._y=c*f*u-d*h*g,this._z=c*h*g+d*f*u,this._w=c*h*u-d*f*g;break;case"YXZ":this._x=d*h*u+c*f*g,this._y=c*f*u-d*h*g,this._z=c*h*g-d*f*u,this._w=c*h*u+d*f*g;break;case"ZXY":this._x=d*h*u-c*f*g,this._y=c*f*u+d*h*g,this._z=c*h*g+d*f*u,this._w=c*h*u-d*f*g;break;case"ZYX":this._x=d*h*u-c*f*g,this._y=c*f*u+d*h*g,this._z=c*h*g-d*f*u,this._w=c*h*u+d*f*g;break;case"YZX":this._x=d*h*u+c*f*g,this._y=c*f*u+d*h*g,this._z=c*h*g-d*f*u,this._w=c*h*u-d*f*g;break;case"XZY":this._x=d*h*u-c*f*g,this._y=c*f*u-d*h*g,this._z=c*h*g+d*f*u,this._w=c*h*u+d*f*g;break;default:Ee("Quaternion: .setFromEuler() encountered an unknown order: "+o)}return t===!0&&this._onChangeCallback(),this}setFromAxisAngle(e,t){let n=t/2,i=Math.sin(n);return this._x=e.x*i,this._y=e.y*i,this._z=e.z*i,this._w=Math.cos(n),this._onChangeCallback(),this}setFromRotationMatrix(e){let t=e.elements,n=t[0],i=t[4],r=t[8],o=t[1],a=t[5],l=t[9],c=t[2],h=t[6],u=t[10],d=n+a+u;if(d>0){let f=.5/Math.sqrt(d+1);this._w=.25/f,this._x=(h-l)*f,this._y=(r-c)*f,this._z=(o-i)*f}else if(n>a&&n>u){let f=2*Math.sqrt(1+n-a-u);this._w=(h-l)/f,this._x=.25*f,this._y=(i+o)/f,this._z=(r+c)/f}else if(a>u){let f=2*Math.sqrt(1+a-n-u);this._w=(r-c)/f,this._x=(i+o)/f,this._y=.25*f,this._z=(l+h)/f}else{let f=2*Math.sqrt(1+u-n-a);this._w=(o-i)/f,this._x=(r+c)/f,this._y=(l+h)/f,this._z=.25*f}return this._onChangeCallback(),this}setFromUnitVectors(e,t){let n=e.dot(t)+1;return n<1e-8?(n=0,Math.abs(e.x)>Math.abs(e.z)?(this._x=-e.y,this._y=e.x,this._z=0,this._w=n):(this._x=0,this._y=-e.z,this._z=e.y,this._w=n)):(this._x=e.y*t.z-e.z*t.y,this._y=e.z*t.x-e.x*t.z,this._z=e.x*t.y-e.y*t.x,this._w=n),this.normalize()}angleTo(e){return 2*Math.acos(Math.abs(qe(this.dot(e),-1,1)))}rotateTowards(e,t){let n=this.angleTo(e);if(n===0)return this;let i=Math.min(1,t/n);return this.slerp(e,i),this}identity(){return this.set(0,0,0,1)}invert(){return this.conjugate()}conjugate(){return this._x*=-1,this._y*=-1,this._z*=-1,this._onChangeCallback(),this}dot(e){return this._x*e._x+this._y*e._y+this._z*e._z+this._w*e._w}lengthSq(){return this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w}length(){return Math.sqrt(this._x*this._x+this._y*this._y+this._z*this._z+this._w*this._w)}normalize(){let e=this.length();return e===0?(this._x=0,this._y=0,this._z=0,this._w=1):(e=1/e,this._x=this._x*e,this._y=this._y*e,this._z=this._z*e,this._w=this._w*e),this._onChangeCallback(),this}multiply(e){return this.multiplyQuaternions(this,e)}premultiply(e){return this.multiplyQuaternions(e,this)}multiplyQuaternions(e,t){let n=e._x,i=e._y,r=e._z,o=e._w,a=t._x,l=t._y,c=t._z,h=t._w;return this._x=n*h+o*a+i*c-r*l,this._y=i*h+o*l+r*a-n*c,this._z=r*h+o*c+n*l-i*a,this._w=o*h-n*a-i*l-r*c,this._onChangeCallback(),this}slerp(e,t){let n=e._x,i=e._y,r=e._z,o=e._w,a=this.dot(e);a<0&&(n=-n,i=-i,r=-r,o=-o,a=-a);let l=1-t;if(a<.9995){let c=Math.acos(a),h=Math.sin(c);l=Math.sin(l*c)/h,t=Math.sin(t*c)/h,this._x=this._x*l+n*t,this._y=this._y*l+i*t,this._z=this._z*l+r*t,this._w=this._w*l+o*t,this._onChangeCallback()}else this._x=this._x*l+n*t,this._y=this._y*l+i*t,this._z=this._z*l+r*t,this._w=this._w*l+o*t,this.normalize();return this}slerpQuaternions(e,t,n){return this.copy(e).slerp(t,n)}random(){let e=2*Math.PI*Math.random(),t=2*Math.PI*Math.random(),n=Math.random(),i=Math.sqrt(1-n),r=Math.sqrt(n);return this.set(i*Math.sin(e),i*Math.cos(e),r*Math.sin(t),r*Math.cos(t))}equals(e){return e._x===this._x&&e._y===this._y&&e._z===this._z&&e._w===this._w}fromArray(e,t=0){return this._x=e[t],this._y=e[t+1],this._z=e[t+2],this._w=e[t+3],this._onChangeCallback(),this}toArray(e=[],t=0){return e[t]=this._x,e[t+1]=this._y,e[t+2]=this._z,e[t+3]=this._w,e}fromBufferAttribute(e,t){return this._x=e.getX(t),this._y=e.getY(t),this._z=e.getZ(t),this._w=e.getW(t),this._onChangeCallback(),this}toJSON(){return this.toArray()}_onChange(e){return this._onChangeCallback=e,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._w}},S=class{static{this.prototype.isVector3=!0}constructor(e=0,t=0,n=0){this.x=e,this.y=t,this.z=n}set(e,t,n){return n===void 0&&(n=this.z),this.x=e,this.y=t,this.z=n,this}setScalar(e){return this.x=e,this.y=e,this.z=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setZ(e){return this.z=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;case 2:this.z=t;break;default:throw new Error("THREE.Vector3: index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;case 2:return this.z;default:throw new Error("THREE.Vector3: index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y,this.z)}copy(e){return this.x=e.x,this.y=e.y,this.z=e.z,this}add(e){return this.x+=e.x,this.y+=e.y,this.z+=e.z,this}addScalar(e){return this.x+=e,this.y+=e,this.z+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this.z=e.z+t.z,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this.z+=e.z*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this.z-=e.z,this}subScalar(e){return this.x-=e,this.y-=e,this.z-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this.z=e.z-t.z,this}multiply(e){return this.x*=e.x,this.y*=e.y,this.z*=e.z,this}multiplyScalar(e){return this.x*=e,this.y*=e,this.z*=e,this}multiplyVectors(e,t){return this.x=e.x*t.x,this.y=e.y*t.y,this.z=e.z*t.z,this}applyEuler(e){return this.applyQuaternion(Kd.setFromEuler(e))}applyAxisAngle(e,t){return this.applyQuaternion(Kd.setFromAxisAngle(e,t))}applyMatrix3(e){let t=this.x,n=this.y,i=this.z,r=e.elements;return this.x=r[0]*t+r[3]*n+r[6]*i,this.y=r[1]*t+r[4]*n+r[7]*i,this.z=r[2]*t+r[5]*n+r[8]*i,this}applyNormalMatrix(e){return this.applyMatrix3(e).normalize()}applyMatrix4(e){let t=this.x,n=this.y,i=this.z,r=e.elements,o=1/(r[3]*t+r[7]*n+r[11]*i+r[15]);return this.x=(r[0]*t+r[4]*n+r[8]*i+r[12])*o,this.y=(r[1]*t+r[5]*n+r[9]*i+r[13])*o,this.z=(r[2]*t+r[6]*n+r[10]*i+r[14])*o,this}applyQuaternion(e){let t=this.x,n=this.y,i=this.z,r=e.x,o=e.y,a=e.z,l=e.w,c=2*(o*i-a*n),h=2*(a*t-r*i),u=2*(r*n-o*t);return this.x=t+l*c+o*u-a*h,this.y=n+l*h+a*c-r*u,this.z=i+l*u+r*h-o*c,this}project(e){return this.applyMatrix4(e.matrixWorldInverse).applyMatrix4(e.projectionMatrix)}unproject(e){return this.applyMatrix4(e.projectionMatrixInverse).applyMatrix4(e.matrixWorld)}transformDirection(e){let t=this.x,n=this.y,i=this.z,r=e.elements;return this.x=r[0]*t+r[4]*n+r[8]*i,this.y=r[1]*t+r[5]*n+r[9]*i,this.z=r[2]*t+r[6]*n+r[10]*i,this.normalize()}divide(e){return this.x/=e.x,this.y/=e.y,this.z/=e.z,this}divideScalar(e){return this.multiplyScalar(1/e)}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this.z=Math.min(this.z,e.z),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this.z=Math.max(this.z,e.z),this}clamp(e,t){return this.x=qe(this.x,e.x,t.x),this.y=qe(this.y,e.y,t.y),this.z=qe(this.z,e.z,t.z),this}clampScalar(e,t){return this.x=qe(this.x,e,t),this.y=qe(this.y,e,t),this.z=qe(this.z,e,t),this}clampLength(e,t){let n=this.length();return this.divideScalar(n||1).multiplyScalar(qe(n,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this}dot(e){return this.x*e.x+this.y*e.y+this.z*e.z}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)}normalize(){return this.divideScalar(this.length()||1)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this.z+=(e.z-this.z)*t,this}lerpVectors(e,t,n){return this.x=e.x+(t.x-e.x)*n,this.y=e.y+(t.y-e.y)*n,this.z=e.z+(t.z-e.z)*n,this}cross(e){return this.crossVectors(this,e)}crossVectors(e,t){let n=e.x,i=e.y,r=e.z,o=t.x,a=t.y,l=t.z;return this.x=i*l-r*a,this.y=r*o-n*l,this.z=n*a-i*o,this}projectOnVector(e){let t=e.lengthSq();if(t===0)return this.set(0,0,0);let n=e.dot(this)/t;return this.copy(e).multiplyScalar(n)}projectOnPlane(e){return lh.copy(this).projectOnVector(e),this.sub(lh)}reflect(e){return this.sub(lh.copy(e).multiplyScalar(2*this.dot(e)))}angleTo(e){let t=Math.sqrt(this.lengthSq()*e.lengthSq());if(t===0)return Math.PI/2;let n=this.dot(e)/t;return Math.acos(qe(n,-1,1))}distanceTo(e){return Math.sqrt(this.distanceToSquared(e))}distanceToSquared(e){let t=this.x-e.x,n=this.y-e.y,i=this.z-e.z;return t*t+n*n+i*i}manhattanDistanceTo(e){return Math.abs(this.x-e.x)+Math.abs(this.y-e.y)+Math.abs(this.z-e.z)}setFromSpherical(e){return this.setFromSphericalCoords(e.radius,e.phi,e.theta)}setFromSphericalCoords(e,t,n){let i=Math.sin(t)*e;return this.x=i*Math.sin(n),this.y=Math.cos(t)*e,this.z=i*Math.cos(n),this}setFromCylindrical(e){return this.setFromCylindricalCoords(e.radius,e.theta,e.y)}setFromCylindricalCoords(e,t,n){return this.x=e*Math.sin(t),this.y=n,this.z=e*Math.cos(t),this}setFromMatrixPosition(e){let t=e.elements;return this.x=t[12],this.y=t[13],this.z=t[14],this}setFromMatrixScale(e){let t=this.setFromMatrixColumn(e,0).length(),n=this.setFromMatrixColumn(e,1).length(),i=this.setFromMatrixColumn(e,2).length();return this.x=t,this.y=n,this.z=i,this}setFromMatrixColumn(e,t){return this.fromArray(e.elements,t*4)}setFromMatrix3Column(e,t){return this.fromArray(e.elements,t*3)}setFromEuler(e){return this.x=e._x,this.y=e._y,this.z=e._z,this}setFromColor(e){return this.x=e.r,this.y=e.g,this.z=e.b,this}equals(e){return e.x===this.x&&e.y===this.y&&e.z===this.z}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this.z=e[t+2],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e[t+2]=this.z,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this.z=e.getZ(t),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this}randomDirection(){let e=Math.random()*Math.PI*2,t=Math.random()*2-1,n=Math.sqrt(1-t*t);return this.x=n*Math.cos(e),this.y=t,this.z=n*Math.sin(e),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z}},lh=new S,Kd=new De,Fe=class{static{this.prototype.isMatrix3=!0}constructor(e,t,n,i,r,o,a,l,c){this.elements=[1,0,0,0,1,0,0,0,1],e!==void 0&&this.set(e,t,n,i,r,o,a,l,c)}set(e,t,n,i,r,o,a,l,c){let h=this.elements;return h[0]=e,h[1]=i,h[2]=a,h[3]=t,h[4]=r,h[5]=l,h[6]=n,h[7]=o,h[8]=c,this}identity(){return this.set(1,0,0,0,1,0,0,0,1),this}copy(e){let t=this.elements,n=e.elements;return t[0]=n[0],t[1]=n[1],t[2]=n[2],t[3]=n[3],t[4]=n[4],t[5]=n[5],t[6]=n[6],t[7]=n[7],t[8]=n[8],this}extractBasis(e,t,n){return e.setFromMatrix3Column(this,0),t.setFromMatrix3Column(this,1),n.setFromMatrix3Column(this,2),this}setFromMatrix4(e){let t=e.elements;return this.set(t[0],t[4],t[8],t[1],t[5],t[9],t[2],t[6],t[10]),this}multiply(e){return this.multiplyMatrices(this,e)}premultiply(e){return this.multiplyMatrices(e,this)}multiplyMatrices(e,t){let n=e.elements,i=t.elements,r=this.elements,o=n[0],a=n[3],l=n[6],c=n[1],h=n[4],u=n[7],d=n[2],f=n[5],g=n[8],y=i[0],p=i[3],m=i[6],b=i[1],E=i[4],M=i[7],R=i[2],T=i[5],x=i[8];return r[0]=o*y+a*b+l*R,r[3]=o*p+a*E+l*T,r[6]=o*m+a*M+l*x,r[1]=c*y+h*b+u*R,r[4]=c*p+h*E+u*T,r[7]=c*m+h*M+u*x,r[2]=d*y+f*b+g*R,r[5]=d*p+f*E+g*T,r[8]=d*m+f*M+g*x,this}multiplyScalar(e){let t=this.elements;return t[0]*=e,t[3]*=e,t[6]*=e,t[1]*=e,t[4]*=e,t[7]*=e,t[2]*=e,t[5]*=e,t[8]*=e,this}determinant(){let e=this.elements,t=e[0],n=e[1],i=e[2],r=e[3],o=e[4],a=e[5],l=e[6],c=e[7],h=e[8];return t*o*h-t*a*c-n*r*h+n*a*l+i*r*c-i*o*l}invert(){let e=this.elements,t=e[0],n=e[1],i=e[2],r=e[3],o=e[4],a=e[5],l=e[6],c=e[7],h=e[8],u=h*o-a*c,d=a*l-h*r,f=c*r-o*l,g=t*u+n*d+i*f;if(g===0)return this.set(0,0,0,0,0,0,0,0,0);let y=1/g;return e[0]=u*y,e[1]=(i*c-h*n)*y,e[2]=(a*n-i*o)*y,e[3]=d*y,e[4]=(h*t-i*l)*y,e[5]=(i*r-a*t)*y,e[6]=f*y,e[7]=(n*l-c*t)*y,e[8]=(o*t-n*r)*y,this}transpose(){let e,t=this.elements;return e=t[1],t[1]=t[3],t[3]=e,e=t[2],t[2]=t[6],t[6]=e,e=t[5],t[5]=t[7],t[7]=e,this}getNormalMatrix(e){return this.setFromMatrix4(e).invert().transpose()}transposeIntoArray(e){let t=this.elements;return e[0]=t[0],e[1]=t[3],e[2]=t[6],e[3]=t[1],e[4]=t[4],e[5]=t[7],e[6]=t[2],e[7]=t[5],e[8]=t[8],this}setUvTransform(e,t,n,i,r,o,a){let l=Math.cos(r),c=Math.sin(r);return this.set(n*l,n*c,-n*(l*o+c*a)+o+e,-i*c,i*l,-i*(-c*o+l*a)+a+t,0,0,1),this}scale(e,t){return hs("Matrix3: .scale() is deprecated. Use .makeScale() instead."),this.premultiply(ch.makeScale(e,t)),this}rotate(e){return hs("Matrix3: .rotate() is deprecated. Use .makeRotation() instead."),this.premultiply(ch.makeRotation(-e)),this}translate(e,t){return hs("Matrix3: .translate() is deprecated. Use .makeTranslation() instead."),this.premultiply(ch.makeTranslation(e,t)),this}makeTranslation(e,t){return e.isVector2?this.set(1,0,e.x,0,1,e.y,0,0,1):this.set(1,0,e,0,1,t,0,0,1),this}makeRotation(e){let t=Math.cos(e),n=Math.sin(e);return this.set(t,-n,0,n,t,0,0,0,1),this}makeScale(e,t){return this.set(e,0,0,0,t,0,0,0,1),this}equals(e){let t=this.elements,n=e.elements;for(let i=0;i<9;i++)if(t[i]!==n[i])return!1;return!0}fromArray(e,t=0){for(let n=0;n<9;n++)this.elements[n]=e[n+t];return this}toArray(e=[],t=0){let n=this.elements;return e[t]=n[0],e[t+1]=n[1],e[t+2]=n[2],e[t+3]=n[3],e[t+4]=n[4],e[t+5]=n[5],e[t+6]=n[6],e[t+7]=n[7],e[t+8]=n[8],e}clone(){return new this.constructor().fromArray(this.elements)}},ch=new Fe,jd=new Fe().set(.4123908,.3575843,.1804808,.212639,.7151687,.0721923,.0193308,.1191948,.9505322),Zd=new Fe().set(3.2409699,-1.5373832,-.4986108,-.9692436,1.8759675,.0415551,.0556301,-.203977,1.0569715);function S0(){let s={enabled:!0,workingColorSpace:an,spaces:{},convert:function(i,r,o){return this.enabled===!1||r===o||!r||!o||(this.spaces[r].transfer===nt&&(i.r=gi(i.r),i.g=gi(i.g),i.b=gi(i.b)),this.spaces[r].primaries!==this.spaces[o].primaries&&(i.applyMatrix3(this.spaces[r].toXYZ),i.applyMatrix3(this.spaces[o].fromXYZ)),this.spaces[o].transfer===nt&&(i.r=tr(i.r),i.g=tr(i.g),i.b=tr(i.b))),i},workingToColorSpace:function(i,r){return this.convert(i,this.workingColorSpace,r)},colorSpaceToWorking:function(i,r){return this.convert(i,r,this.workingColorSpace)},getPrimaries:function(i){return this.spaces[i].primaries},getTransfer:function(i){return i===Wn?jr:this.spaces[i].transfer},getToneMappingMode:function(i){return this.spaces[i].outputColorSpaceConfig.toneMappingMode||"standard"},getLuminanceCoefficients:function(i,r=this.workingColorSpace){return i.fromArray(this.spaces[r].luminanceCoefficients)},define:function(i){Object.assign(this.spaces,i)},_getMatrix:function(i,r,o){return i.copy(this.spaces[o].fromXYZ).multiply(this.spaces[r].toXYZ)},_getDrawingBufferColorSpace:function(i){return this.spaces[i].outputColorSpaceConfig.drawingBufferColorSpace},_getUnpackColorSpace:function(i=this.workingColorSpace){return this.spaces[i].workingColorSpaceConfig.unpackColorSpace}},e=[.64,.33,.3,.6,.15,.06],t=[.2126,.7152,.0722],n=[.3127,.329];return s.define({[an]:{primaries:e,whitePoint:n,transfer:jr,toXYZ:jd,fromXYZ:Zd,luminanceCoefficients:t,workingColorSpaceConfig:{unpackColorSpace:ot},outputColorSpaceConfig:{drawingBufferColorSpace:ot}},[ot]:{primaries:e,whitePoint:n,transfer:nt,toXYZ:jd,fromXYZ:Zd,luminanceCoefficients:t,outputColorSpaceConfig:{drawingBufferColorSpace:ot}}}),s}var Xe=S0();function gi(s){return s<.04045?s*.0773993808:Math.pow(s*.9478672986+.0521327014,2.4)}function tr(s){return s<.0031308?s*12.92:1.055*Math.pow(s,.41666)-.055}var Us,Oa=class{static getDataURL(e,t="image/png"){if(/^data:/i.test(e.src)||typeof HTMLCanvasElement>"u")return e.src;let n;if(e instanceof HTMLCanvasElement)n=e;else{Us===void 0&&(Us=rr("canvas")),Us.width=e.width,Us.height=e.height;let i=Us.getContext("2d");e instanceof ImageData?i.putImageData(e,0,0):i.drawImage(e,0,0,e.width,e.height),n=Us}return n.toDataURL(t)}static sRGBToLinear(e){if(typeof HTMLImageElement<"u"&&e instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&e instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&e instanceof ImageBitmap){let t=rr("canvas");t.width=e.width,t.height=e.height;let n=t.getContext("2d");n.drawImage(e,0,0,e.width,e.height);let i=n.getImageData(0,0,e.width,e.height),r=i.data;for(let o=0;o<r.length;o++)r[o]=gi(r[o]/255)*255;return n.putImageData(i,0,0),t}else if(e.data){let t=e.data.slice(0);for(let n=0;n<t.length;n++)t instanceof Uint8Array||t instanceof Uint8ClampedArray?t[n]=Math.floor(gi(t[n]/255)*255):t[n]=gi(t[n]);return{data:t,width:e.width,height:e.height}}else return Ee("ImageUtils.sRGBToLinear(): Unsupported image type. No color space conversion applied."),e}},T0=0,ar=class{constructor(e=null){this.isTextureSource=!0,Object.defineProperty(this,"id",{value:T0++}),this.uuid=ni(),this.data=e,this.dataReady=!0,this.version=0}getSize(e){let t=this.data;return typeof HTMLVideoElement<"u"&&t instanceof HTMLVideoElement?e.set(t.videoWidth,t.videoHeight,0):typeof VideoFrame<"u"&&t instanceof VideoFrame?e.set(t.displayWidth,t.displayHeight,0):t!==null?e.set(t.width||0,t.height||0,t.depth||0):e.set(0,0,0),e}set needsUpdate(e){e===!0&&this.version++}toJSON(e){let t=e===void 0||typeof e=="string";if(!t&&e.images[this.uuid]!==void 0)return e.images[this.uuid];let n={uuid:this.uuid,url:""},i=this.data;if(i!==null){let r;if(Array.isArray(i)){r=[];for(let o=0,a=i.length;o<a;o++)i[o].isDataTexture?r.push(hh(i[o].image)):r.push(hh(i[o]))}else r=hh(i);n.url=r}return t||(e.images[this.uuid]=n),n}};function hh(s){return typeof HTMLImageElement<"u"&&s instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&s instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&s instanceof ImageBitmap?Oa.getDataURL(s):s.data?{data:Array.from(s.data),width:s.width,height:s.height,type:s.data.constructor.name}:(Ee("Texture: Unable to serialize Texture."),{})}var A0=0,uh=new S,Nt=class s extends Bn{constructor(e=s.DEFAULT_IMAGE,t=s.DEFAULT_MAPPING,n=Cn,i=Cn,r=St,o=Ln,a=Dn,l=pn,c=s.DEFAULT_ANISOTROPY,h=Wn){super(),this.isTexture=!0,Object.defineProperty(this,"id",{value:A0++}),this.uuid=ni(),this.name="",this.source=new ar(e),this.mipmaps=[],this.mapping=t,this.channel=0,this.wrapS=n,this.wrapT=i,this.magFilter=r,this.minFilter=o,this.anisotropy=c,this.format=a,this.internalFormat=null,this.type=l,this.offset=new ye(0,0),this.repeat=new ye(1,1),this.center=new ye(0,0),this.rotation=0,this.matrixAutoUpdate=!0,this.matrix=new Fe,this.generateMipmaps=!0,this.mipmapsAutoUpdate=!0,this.premultiplyAlpha=!1,this.flipY=!0,this.unpackAlignment=4,this.colorSpace=h,this.userData={},this.updateRanges=[],this.version=0,this.onUpdate=null,this.renderTarget=null,this.isRenderTargetTexture=!1,this.isArrayTexture=!!(e&&e.depth&&e.depth>1),this.pmremVersion=0,this.isPMREMTexture=!1,this.normalized=!1}get width(){return this.source.getSize(uh).x}get height(){return this.source.getSize(uh).y}get depth(){return this.source.getSize(uh).z}get image(){return this.source.data}set image(e){this.source.data=e}updateMatrix(){this.matrix.setUvTransform(this.offset.x,this.offset.y,this.repeat.x,this.repeat.y,this.rotation,this.center.x,this.center.y)}addUpdateRange(e,t){this.updateRanges.push({start:e,count:t})}clearUpdateRanges(){this.updateRanges.length=0}clone(){return new this.constructor().copy(this)}copy(e){return this.name=e.name,this.source=e.source,this.mipmaps=e.mipmaps.slice(0),this.mapping=e.mapping,this.channel=e.channel,this.wrapS=e.wrapS,this.wrapT=e.wrapT,this.magFilter=e.magFilter,this.minFilter=e.minFilter,this.anisotropy=e.anisotropy,this.format=e.format,this.internalFormat=e.internalFormat,this.type=e.type,this.normalized=e.normalized,this.offset.copy(e.offset),this.repeat.copy(e.repeat),this.center.copy(e.center),this.rotation=e.rotation,this.matrixAutoUpdate=e.matrixAutoUpdate,this.matrix.copy(e.matrix),this.generateMipmaps=e.generateMipmaps,this.mipmapsAutoUpdate=e.mipmapsAutoUpdate,this.premultiplyAlpha=e.premultiplyAlpha,this.flipY=e.flipY,this.unpackAlignment=e.unpackAlignment,this.colorSpace=e.colorSpace,this.renderTarget=e.renderTarget,this.isRenderTargetTexture=e.isRenderTargetTexture,this.isPMREMTexture=e.isPMREMTexture,this.isArrayTexture=e.isArrayTexture,this.userData=JSON.parse(JSON.stringify(e.userData)),this.needsUpdate=!0,this}setValues(e){for(let t in e){let n=e[t];if(n===void 0){Ee(`Texture.setValues(): parameter '${t}' has value of undefined.`);continue}let i=this[t];if(i===void 0){Ee(`Texture.setValues(): property '${t}' does not exist.`);continue}i&&n&&i.isVector2&&n.isVector2||i&&n&&i.isVector3&&n.isVector3||i&&n&&i.isMatrix3&&n.isMatrix3?i.copy(n):this[t]=n}}toJSON(e){let t=e===void 0||typeof e=="string";if(!t&&e.textures[this.uuid]!==void 0)return e.textures[this.uuid];let n={metadata:{version:4.7,type:"Texture",generator:"Texture.toJSON"},uuid:this.uuid,name:this.name,image:this.source.toJSON(e).uuid,mapping:this.mapping,channel:this.channel,repeat:[this.repeat.x,this.repeat.y],offset:[this.offset.x,this.offset.y],center:[this.center.x,this.center.y],rotation:this.rotation,wrap:[this.wrapS,this.wrapT],format:this.format,internalFormat:this.internalFormat,type:this.type,normalized:this.normalized,colorSpace:this.colorSpace,minFilter:this.minFilter,magFilter:this.magFilter,anisotropy:this.anisotropy,flipY:this.flipY,generateMipmaps:this.generateMipmaps,mipmapsAutoUpdate:this.mipmapsAutoUpdate,premultiplyAlpha:this.premultiplyAlpha,unpackAlignment:this.unpackAlignment};return Object.keys(this.userData).length>0&&(n.userData=this.userData),t||(e.textures[this.uuid]=n),n}dispose(){this.dispatchEvent({type:"dispose"})}transformUv(e){if(this.mapping!==ou)return e;if(e.applyMatrix3(this.matrix),e.x<0||e.x>1)switch(this.wrapS){case zi:e.x=e.x-Math.floor(e.x);break;case Cn:e.x=e.x<0?0:1;break;case Hi:Math.abs(Math.floor(e.x)%2)===1?e.x=Math.ceil(e.x)-e.x:e.x=e.x-Math.floor(e.x);break}if(e.y<0||e.y>1)switch(this.wrapT){case zi:e.y=e.y-Math.floor(e.y);break;case Cn:e.y=e.y<0?0:1;break;case Hi:Math.abs(Math.floor(e.y)%2)===1?e.y=Math.ceil(e.y)-e.y:e.y=e.y-Math.floor(e.y);break}return this.flipY&&(e.y=1-e.y),e}set needsUpdate(e){e===!0&&(this.version++,this.source.needsUpdate=!0)}set needsPMREMUpdate(e){e===!0&&this.pmremVersion++}};Nt.DEFAULT_IMAGE=null;Nt.DEFAULT_MAPPING=ou;Nt.DEFAULT_ANISOTROPY=1;var at=class{static{this.prototype.isVector4=!0}constructor(e=0,t=0,n=0,i=1){this.x=e,this.y=t,this.z=n,this.w=i}get width(){return this.z}set width(e){this.z=e}get height(){return this.w}set height(e){this.w=e}set(e,t,n,i){return this.x=e,this.y=t,this.z=n,this.w=i,this}setScalar(e){return this.x=e,this.y=e,this.z=e,this.w=e,this}setX(e){return this.x=e,this}setY(e){return this.y=e,this}setZ(e){return this.z=e,this}setW(e){return this.w=e,this}setComponent(e,t){switch(e){case 0:this.x=t;break;case 1:this.y=t;break;case 2:this.z=t;break;case 3:this.w=t;break;default:throw new Error("THREE.Vector4: index is out of range: "+e)}return this}getComponent(e){switch(e){case 0:return this.x;case 1:return this.y;case 2:return this.z;case 3:return this.w;default:throw new Error("THREE.Vector4: index is out of range: "+e)}}clone(){return new this.constructor(this.x,this.y,this.z,this.w)}copy(e){return this.x=e.x,this.y=e.y,this.z=e.z,this.w=e.w!==void 0?e.w:1,this}add(e){return this.x+=e.x,this.y+=e.y,this.z+=e.z,this.w+=e.w,this}addScalar(e){return this.x+=e,this.y+=e,this.z+=e,this.w+=e,this}addVectors(e,t){return this.x=e.x+t.x,this.y=e.y+t.y,this.z=e.z+t.z,this.w=e.w+t.w,this}addScaledVector(e,t){return this.x+=e.x*t,this.y+=e.y*t,this.z+=e.z*t,this.w+=e.w*t,this}sub(e){return this.x-=e.x,this.y-=e.y,this.z-=e.z,this.w-=e.w,this}subScalar(e){return this.x-=e,this.y-=e,this.z-=e,this.w-=e,this}subVectors(e,t){return this.x=e.x-t.x,this.y=e.y-t.y,this.z=e.z-t.z,this.w=e.w-t.w,this}multiply(e){return this.x*=e.x,this.y*=e.y,this.z*=e.z,this.w*=e.w,this}multiplyScalar(e){return this.x*=e,this.y*=e,this.z*=e,this.w*=e,this}applyMatrix4(e){let t=this.x,n=this.y,i=this.z,r=this.w,o=e.elements;return this.x=o[0]*t+o[4]*n+o[8]*i+o[12]*r,this.y=o[1]*t+o[5]*n+o[9]*i+o[13]*r,this.z=o[2]*t+o[6]*n+o[10]*i+o[14]*r,this.w=o[3]*t+o[7]*n+o[11]*i+o[15]*r,this}divide(e){return this.x/=e.x,this.y/=e.y,this.z/=e.z,this.w/=e.w,this}divideScalar(e){return this.multiplyScalar(1/e)}setAxisAngleFromQuaternion(e){this.w=2*Math.acos(e.w);let t=Math.sqrt(1-e.w*e.w);return t<1e-4?(this.x=1,this.y=0,this.z=0):(this.x=e.x/t,this.y=e.y/t,this.z=e.z/t),this}setAxisAngleFromRotationMatrix(e){let t,n,i,r,l=e.elements,c=l[0],h=l[4],u=l[8],d=l[1],f=l[5],g=l[9],y=l[2],p=l[6],m=l[10];if(Math.abs(h-d)<.01&&Math.abs(u-y)<.01&&Math.abs(g-p)<.01){if(Math.abs(h+d)<.1&&Math.abs(u+y)<.1&&Math.abs(g+p)<.1&&Math.abs(c+f+m-3)<.1)return this.set(1,0,0,0),this;t=Math.PI;let E=(c+1)/2,M=(f+1)/2,R=(m+1)/2,T=(h+d)/4,x=(u+y)/4,w=(g+p)/4;return E>M&&E>R?E<.01?(n=0,i=.707106781,r=.707106781):(n=Math.sqrt(E),i=T/n,r=x/n):M>R?M<.01?(n=.707106781,i=0,r=.707106781):(i=Math.sqrt(M),n=T/i,r=w/i):R<.01?(n=.707106781,i=.707106781,r=0):(r=Math.sqrt(R),n=x/r,i=w/r),this.set(n,i,r,t),this}let b=Math.sqrt((p-g)*(p-g)+(u-y)*(u-y)+(d-h)*(d-h));return Math.abs(b)<.001&&(b=1),this.x=(p-g)/b,this.y=(u-y)/b,this.z=(d-h)/b,this.w=Math.acos((c+f+m-1)/2),this}setFromMatrixPosition(e){let t=e.elements;return this.x=t[12],this.y=t[13],this.z=t[14],this.w=t[15],this}min(e){return this.x=Math.min(this.x,e.x),this.y=Math.min(this.y,e.y),this.z=Math.min(this.z,e.z),this.w=Math.min(this.w,e.w),this}max(e){return this.x=Math.max(this.x,e.x),this.y=Math.max(this.y,e.y),this.z=Math.max(this.z,e.z),this.w=Math.max(this.w,e.w),this}clamp(e,t){return this.x=qe(this.x,e.x,t.x),this.y=qe(this.y,e.y,t.y),this.z=qe(this.z,e.z,t.z),this.w=qe(this.w,e.w,t.w),this}clampScalar(e,t){return this.x=qe(this.x,e,t),this.y=qe(this.y,e,t),this.z=qe(this.z,e,t),this.w=qe(this.w,e,t),this}clampLength(e,t){let n=this.length();return this.divideScalar(n||1).multiplyScalar(qe(n,e,t))}floor(){return this.x=Math.floor(this.x),this.y=Math.floor(this.y),this.z=Math.floor(this.z),this.w=Math.floor(this.w),this}ceil(){return this.x=Math.ceil(this.x),this.y=Math.ceil(this.y),this.z=Math.ceil(this.z),this.w=Math.ceil(this.w),this}round(){return this.x=Math.round(this.x),this.y=Math.round(this.y),this.z=Math.round(this.z),this.w=Math.round(this.w),this}roundToZero(){return this.x=Math.trunc(this.x),this.y=Math.trunc(this.y),this.z=Math.trunc(this.z),this.w=Math.trunc(this.w),this}negate(){return this.x=-this.x,this.y=-this.y,this.z=-this.z,this.w=-this.w,this}dot(e){return this.x*e.x+this.y*e.y+this.z*e.z+this.w*e.w}lengthSq(){return this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w}length(){return Math.sqrt(this.x*this.x+this.y*this.y+this.z*this.z+this.w*this.w)}manhattanLength(){return Math.abs(this.x)+Math.abs(this.y)+Math.abs(this.z)+Math.abs(this.w)}normalize(){return this.divideScalar(this.length()||1)}setLength(e){return this.normalize().multiplyScalar(e)}lerp(e,t){return this.x+=(e.x-this.x)*t,this.y+=(e.y-this.y)*t,this.z+=(e.z-this.z)*t,this.w+=(e.w-this.w)*t,this}lerpVectors(e,t,n){return this.x=e.x+(t.x-e.x)*n,this.y=e.y+(t.y-e.y)*n,this.z=e.z+(t.z-e.z)*n,this.w=e.w+(t.w-e.w)*n,this}equals(e){return e.x===this.x&&e.y===this.y&&e.z===this.z&&e.w===this.w}fromArray(e,t=0){return this.x=e[t],this.y=e[t+1],this.z=e[t+2],this.w=e[t+3],this}toArray(e=[],t=0){return e[t]=this.x,e[t+1]=this.y,e[t+2]=this.z,e[t+3]=this.w,e}fromBufferAttribute(e,t){return this.x=e.getX(t),this.y=e.getY(t),this.z=e.getZ(t),this.w=e.getW(t),this}random(){return this.x=Math.random(),this.y=Math.random(),this.z=Math.random(),this.w=Math.random(),this}*[Symbol.iterator](){yield this.x,yield this.y,yield this.z,yield this.w}},Ua=class extends Bn{constructor(e=1,t=1,n={}){super(),n=Object.assign({generateMipmaps:!1,internalFormat:null,minFilter:St,depthBuffer:!0,stencilBuffer:!1,resolveColorBuffer:!0,resolveDepthBuffer:!0,resolveStencilBuffer:!0,storeMultisampledColorBuffer:!0,storeMultisampledDepthBuffer:!0,storeMultisampledStencilBuffer:!0,depthTexture:null,samples:0,count:1,depth:1,multiview:!1,useArrayDepthTexture:!1},n),this.isRenderTarget=!0,this.width=e,this.height=t,this.depth=n.depth,this.scissor=new at(0,0,e,t),this.scissorTest=!1,this.viewport=new at(0,0,e,t),this.textures=[];let i=n.count;for(let r=0;r<i;r++)this.textures[r]=new Nt({width:e,height:t,depth:n.depth}),this.textures[r].isRenderTargetTexture=!0,this.textures[r].renderTarget=this;this._setTextureOptions(n),this.depthBuffer=n.depthBuffer,this.stencilBuffer=n.stencilBuffer,this.resolveColorBuffer=n.resolveColorBuffer,this.resolveDepthBuffer=n.resolveDepthBuffer,this.resolveStencilBuffer=n.resolveStencilBuffer,this.storeMultisampledColorBuffer=n.storeMultisampledColorBuffer,this.storeMultisampledDepthBuffer=n.storeMultisampledDepthBuffer,this.storeMultisampledStencilBuffer=n.storeMultisampledStencilBuffer,this._depthTexture=null,this.depthTexture=n.depthTexture,this.samples=n.samples,this.multiview=n.multiview,this.useArrayDepthTexture=n.useArrayDepthTexture}_setTextureOptions(e={}){let t={minFilter:St,generateMipmaps:!1,flipY:!1,internalFormat:null};e.mapping!==void 0&&(t.mapping=e.mapping),e.wrapS!==void 0&&(t.wrapS=e.wrapS),e.wrapT!==void 0&&(t.wrapT=e.wrapT),e.wrapR!==void 0&&(t.wrapR=e.wrapR),e.magFilter!==void 0&&(t.magFilter=e.magFilter),e.minFilter!==void 0&&(t.minFilter=e.minFilter),e.format!==void 0&&(t.format=e.format),e.type!==void 0&&(t.type=e.type),e.anisotropy!==void 0&&(t.anisotropy=e.anisotropy),e.colorSpace!==void 0&&(t.colorSpace=e.colorSpace),e.flipY!==void 0&&(t.flipY=e.flipY),e.generateMipmaps!==void 0&&(t.generateMipmaps=e.generateMipmaps),e.mipmapsAutoUpdate!==void 0&&(t.mipmapsAutoUpdate=e.mipmapsAutoUpdate),e.internalFormat!==void 0&&(t.internalFormat=e.internalFormat);for(let n=0;n<this.textures.length;n++)this.textures[n].setValues(t)}get texture(){return this.textures[0]}set texture(e){this.textures[0]=e}set depthTexture(e){this._depthTexture!==null&&this._depthTexture.renderTarget===this&&(this._depthTexture.renderTarget=null),e!==null&&e.renderTarget===null&&(e.renderTarget=this),this._depthTexture=e}get depthTexture(){return this._depthTexture}setSize(e,t,n=1){if(this.width!==e||this.height!==t||this.depth!==n){this.width=e,this.height=t,this.depth=n;for(let i=0,r=this.textures.length;i<r;i++)this.textures[i].image.width=e,this.textures[i].image.height=t,this.textures[i].image.depth=n,this.textures[i].isData3DTexture!==!0&&(this.textures[i].isArrayTexture=this.textures[i].image.depth>1);this.dispose()}this.viewport.set(0,0,e,t),this.scissor.set(0,0,e,t)}clone(){return new this.constructor().copy(this)}copy(e){this.width=e.width,this.height=e.height,this.depth=e.depth,this.scissor.copy(e.scissor),this.scissorTest=e.scissorTest,this.viewport.copy(e.viewport),this.textures.length=0;for(let t=0,n=e.textures.length;t<n;t++){this.textures[t]=e.textures[t].clone(),this.textures[t].isRenderTargetTexture=!0,this.textures[t].renderTarget=this;let i=Object.assign({},e.textures[t].image);this.textures[t].source=new ar(i)}if(this.depthBuffer=e.depthBuffer,this.stencilBuffer=e.stencilBuffer,this.resolveColorBuffer=e.resolveColorBuffer,this.resolveDepthBuffer=e.resolveDepthBuffer,this.resolveStencilBuffer=e.resolveStencilBuffer,this.storeMultisampledColorBuffer=e.storeMultisampledColorBuffer,this.storeMultisampledDepthBuffer=e.storeMultisampledDepthBuffer,this.storeMultisampledStencilBuffer=e.storeMultisampledStencilBuffer,e.depthTexture!==null)if(e.depthTexture.renderTarget===e){let t=e.depthTexture.clone();t.renderTarget=null,this.depthTexture=t}else this.depthTexture=e.depthTexture;else this.depthTexture=null;return this.samples=e.samples,this.multiview=e.multiview,this.useArrayDepthTexture=e.useArrayDepthTexture,this}dispose(){this.dispatchEvent({type:"dispose"})}},Tt=class extends Ua{constructor(e=1,t=1,n={}){super(e,t,n),this.isWebGLRenderTarget=!0}},Jr=class extends Nt{constructor(e=null,t=1,n=1,i=1){super(null),this.isDataArrayTexture=!0,this.image={data:e,width:t,height:n,depth:i},this.magFilter=gt,this.minFilter=gt,this.wrapR=Cn,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1,this.layerUpdates=new Set}copy(e){return super.copy(e),this.wrapR=e.wrapR,this}addLayerUpdate(e){this.layerUpdates.add(e)}clearLayerUpdates(){this.layerUpdates.clear()}};var Fa=class extends Nt{constructor(e=null,t=1,n=1,i=1){super(null),this.isData3DTexture=!0,this.image={data:e,width:t,height:n,depth:i},this.magFilter=gt,this.minFilter=gt,this.wrapR=Cn,this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}copy(e){return super.copy(e),this.wrapR=e.wrapR,this}};var _e=class s{static{this.prototype.isMatrix4=!0}constructor(e,t,n,i,r,o,a,l,c,h,u,d,f,g,y,p){this.elements=[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1],e!==void 0&&this.set(e,t,n,i,r,o,a,l,c,h,u,d,f,g,y,p)}set(e,t,n,i,r,o,a,l,c,h,u,d,f,g,y,p){let m=this.elements;return m[0]=e,m[4]=t,m[8]=n,m[12]=i,m[1]=r,m[5]=o,m[9]=a,m[13]=l,m[2]=c,m[6]=h,m[10]=u,m[14]=d,m[3]=f,m[7]=g,m[11]=y,m[15]=p,this}identity(){return this.set(1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1),this}clone(){return new s().fromArray(this.elements)}copy(e){let t=this.elements,n=e.elements;return t[0]=n[0],t[1]=n[1],t[2]=n[2],t[3]=n[3],t[4]=n[4],t[5]=n[5],t[6]=n[6],t[7]=n[7],t[8]=n[8],t[9]=n[9],t[10]=n[10],t[11]=n[11],t[12]=n[12],t[13]=n[13],t[14]=n[14],t[15]=n[15],this}copyPosition(e){let t=this.elements,n=e.elements;return t[12]=n[12],t[13]=n[13],t[14]=n[14],this}setFromMatrix3(e){let t=e.elements;return this.set(t[0],t[3],t[6],0,t[1],t[4],t[7],0,t[2],t[5],t[8],0,0,0,0,1),this}extractBasis(e,t,n){return this.determinantAffine()===0?(e.set(1,0,0),t.set(0,1,0),n.set(0,0,1),this):(e.setFromMatrixColumn(this,0),t.setFromMatrixColumn(this,1),n.setFromMatrixColumn(this,2),this)}makeBasis(e,t,n){return this.set(e.x,t.x,n.x,0,e.y,t.y,n.y,0,e.z,t.z,n.z,0,0,0,0,1),this}extractRotation(e){if(e.determinantAffine()===0)return this.identity();let t=this.elements,n=e.elements,i=1/Fs.setFromMatrixColumn(e,0).length(),r=1/Fs.setFromMatrixColumn(e,1).length(),o=1/Fs.setFromMatrixColumn(e,2).length();return t[0]=n[0]*i,t[1]=n[1]*i,t[2]=n[2]*i,t[3]=0,t[4]=n[4]*r,t[5]=n[5]*r,t[6]=n[6]*r,t[7]=0,t[8]=n[8]*o,t[9]=n[9]*o,t[10]=n[10]*o,t[11]=0,t[12]=0,t[13]=0,t[14]=0,t[15]=1,this}makeRotationFromEuler(e){let t=this.elements,n=e.x,i=e.y,r=e.z,o=Math.cos(n),a=Math.sin(n),l=Math.cos(i),c=Math.sin(i),h=Math.cos(r),u=Math.sin(r);if(e.order==="XYZ"){let d=o*h,f=o*u,g=a*h,y=a*u;t[0]=l*h,t[4]=-l*u,t[8]=c,t[1]=f+g*c,t[5]=d-y*c,t[9]=-a*l,t[2]=y-d*c,t[6]=g+f*c,t[10]=o*l}else if(e.order==="YXZ"){let d=l*h,f=l*u,g=c*h,y=c*u;t[0]=d+y*a,t[4]=g*a-f,t[8]=o*c,t[1]=o*u,t[5]=o*h,t[9]=-a,t[2]=f*a-g,t[6]=y+d*a,t[10]=o*l}else if(e.order==="ZXY"){let d=l*h,f=l*u,g=c*h,y=c*u;t[0]=d-y*a,t[4]=-o*u,t[8]=g+f*a,t[1]=f+g*a,t[5]=o*h,t[9]=y-d*a,t[2]=-o*c,t[6]=a,t[10]=o*l}else if(e.order==="ZYX"){let d=o*h,f=o*u,g=a*h,y=a*u;t[0]=l*h,t[4]=g*c-f,t[8]=d*c+y,t[1]=l*u,t[5]=y*c+d,t[9]=f*c-g,t[2]=-c,t[6]=a*l,t[10]=o*l}else if(e.order==="YZX"){let d=o*l,f=o*c,g=a*l,y=a*c;t[0]=l*h,t[4]=y-d*u,t[8]=g*u+f,t[1]=u,t[5]=o*h,t[9]=-a*h,t[2]=-c*h,t[6]=f*u+g,t[10]=d-y*u}else if(e.order==="XZY"){let d=o*l,f=o*c,g=a*l,y=a*c;t[0]=l*h,t[4]=-u,t[8]=c*h,t[1]=d*u+y,t[5]=o*h,t[9]=f*u-g,t[2]=g*u-f,t[6]=a*h,t[10]=y*u+d}return t[3]=0,t[7]=0,t[11]=0,t[12]=0,t[13]=0,t[14]=0,t[15]=1,this}makeRotationFromQuaternion(e){return this.compose(E0,e,R0)}lookAt(e,t,n){let i=this.elements;return xn.subVectors(e,t),xn.lengthSq()===0&&(xn.z=1),xn.normalize(),Ni.crossVectors(n,xn),Ni.lengthSq()===0&&(Math.abs(n.z)===1?xn.x+=1e-4:xn.z+=1e-4,xn.normalize(),Ni.crossVectors(n,xn)),Ni.normalize(),Ko.crossVectors(xn,Ni),i[0]=Ni.x,i[4]=Ko.x,i[8]=xn.x,i[1]=Ni.y,i[5]=Ko.y,i[9]=xn.y,i[2]=Ni.z,i[6]=Ko.z,i[10]=xn.z,this}multiply(e){return this.multiplyMatrices(this,e)}premultiply(e){return this.multiplyMatrices(e,this)}multiplyMatrices(e,t){let n=e.elements,i=t.elements,r=this.elements,o=n[0],a=n[4],l=n[8],c=n[12],h=n[1],u=n[5],d=n[9],f=n[13],g=n[2],y=n[6],p=n[10],m=n[14],b=n[3],E=n[7],M=n[11],R=n[15],T=i[0],x=i[4],w=i[8],O=i[12],I=i[1],N=i[5],k=i[9],V=i[13],P=i[2],G=i[6],q=i[10],H=i[14],te=i[3],X=i[7],J=i[11],Q=i[15];return r[0]=o*T+a*I+l*P+c*te,r[4]=o*x+a*N+l*G+c*X,r[8]=o*w+a*k+l*q+c*J,r[12]=o*O+a*V+l*H+c*Q,r[1]=h*T+u*I+d*P+f*te,r[5]=h*x+u*N+d*G+f*X,r[9]=h*w+u*k+d*q+f*J,r[13]=h*O+u*V+d*H+f*Q,r[2]=g*T+y*I+p*P+m*te,r[6]=g*x+y*N+p*G+m*X,r[10]=g*w+y*k+p*q+m*J,r[14]=g*O+y*V+p*H+m*Q,r[3]=b*T+E*I+M*P+R*te,r[7]=b*x+E*N+M*G+R*X,r[11]=b*w+E*k+M*q+R*J,r[15]=b*O+E*V+M*H+R*Q,this}multiplyScalar(e){let t=this.elements;return t[0]*=e,t[4]*=e,t[8]*=e,t[12]*=e,t[1]*=e,t[5]*=e,t[9]*=e,t[13]*=e,t[2]*=e,t[6]*=e,t[10]*=e,t[14]*=e,t[3]*=e,t[7]*=e,t[11]*=e,t[15]*=e,this}determinant(){let e=this.elements,t=e[0],n=e[4],i=e[8],r=e[12],o=e[1],a=e[5],l=e[9],c=e[13],h=e[2],u=e[6],d=e[10],f=e[14],g=e[3],y=e[7],p=e[11],m=e[15],b=l*f-c*d,E=a*f-c*u,M=a*d-l*u,R=o*f-c*h,T=o*d-l*h,x=o*u-a*h;return t*(y*b-p*E+m*M)-n*(g*b-p*R+m*T)+i*(g*E-y*R+m*x)-r*(g*M-y*T+p*x)}determinantAffine(){let e=this.elements,t=e[0],n=e[4],i=e[8],r=e[1],o=e[5],a=e[9],l=e[2],c=e[6],h=e[10];return t*(o*h-a*c)-n*(r*h-a*l)+i*(r*c-o*l)}transpose(){let e=this.elements,t;return t=e[1],e[1]=e[4],e[4]=t,t=e[2],e[2]=e[8],e[8]=t,t=e[6],e[6]=e[9],e[9]=t,t=e[3],e[3]=e[12],e[12]=t,t=e[7],e[7]=e[13],e[13]=t,t=e[11],e[11]=e[14],e[14]=t,this}setPosition(e,t,n){let i=this.elements;return e.isVector3?(i[12]=e.x,i[13]=e.y,i[14]=e.z):(i[12]=e,i[13]=t,i[14]=n),this}invert(){let e=this.elements,t=e[0],n=e[1],i=e[2],r=e[3],o=e[4],a=e[5],l=e[6],c=e[7],h=e[8],u=e[9],d=e[10],f=e[11],g=e[12],y=e[13],p=e[14],m=e[15],b=t*a-n*o,E=t*l-i*o,M=t*c-r*o,R=n*l-i*a,T=n*c-r*a,x=i*c-r*l,w=h*y-u*g,O=h*p-d*g,I=h*m-f*g,N=u*p-d*y,k=u*m-f*y,V=d*m-f*p,P=b*V-E*k+M*N+R*I-T*O+x*w;if(P===0)return this.set(0,0,0,0,0,0,0,0,0,0,0,0,0,0,0,0);let G=1/P;return e[0]=(a*V-l*k+c*N)*G,e[1]=(i*k-n*V-r*N)*G,e[2]=(y*x-p*T+m*R)*G,e[3]=(d*T-u*x-f*R)*G,e[4]=(l*I-o*V-c*O)*G,e[5]=(t*V-i*I+r*O)*G,e[6]=(p*M-g*x-m*E)*G,e[7]=(h*x-d*M+f*E)*G,e[8]=(o*k-a*I+c*w)*G,e[9]=(n*I-t*k-r*w)*G,e[10]=(g*T-y*M+m*b)*G,e[11]=(u*M-h*T-f*b)*G,e[12]=(a*O-o*N-l*w)*G,e[13]=(t*N-n*O+i*w)*G,e[14]=(y*E-g*R-p*b)*G,e[15]=(h*R-u*E+d*b)*G,this}scale(e){let t=this.elements,n=e.x,i=e.y,r=e.z;return t[0]*=n,t[4]*=i,t[8]*=r,t[1]*=n,t[5]*=i,t[9]*=r,t[2]*=n,t[6]*=i,t[10]*=r,t[3]*=n,t[7]*=i,t[11]*=r,this}getMaxScaleOnAxis(){let e=this.elements,t=e[0]*e[0]+e[1]*e[1]+e[2]*e[2],n=e[4]*e[4]+e[5]*e[5]+e[6]*e[6],i=e[8]*e[8]+e[9]*e[9]+e[10]*e[10];return Math.sqrt(Math.max(t,n,i))}makeTranslation(e,t,n){return e.isVector3?this.set(1,0,0,e.x,0,1,0,e.y,0,0,1,e.z,0,0,0,1):this.set(1,0,0,e,0,1,0,t,0,0,1,n,0,0,0,1),this}makeRotationX(e){let t=Math.cos(e),n=Math.sin(e);return this.set(1,0,0,0,0,t,-n,0,0,n,t,0,0,0,0,1),this}makeRotationY(e){let t=Math.cos(e),n=Math.sin(e);return this.set(t,0,n,0,0,1,0,0,-n,0,t,0,0,0,0,1),this}makeRotationZ(e){let t=Math.cos(e),n=Math.sin(e);return this.set(t,-n,0,0,n,t,0,0,0,0,1,0,0,0,0,1),this}makeRotationAxis(e,t){let n=Math.cos(t),i=Math.sin(t),r=1-n,o=e.x,a=e.y,l=e.z,c=r*o,h=r*a;return this.set(c*o+n,c*a-i*l,c*l+i*a,0,c*a+i*l,h*a+n,h*l-i*o,0,c*l-i*a,h*l+i*o,r*l*l+n,0,0,0,0,1),this}makeScale(e,t,n){return this.set(e,0,0,0,0,t,0,0,0,0,n,0,0,0,0,1),this}makeShear(e,t,n,i,r,o){return this.set(1,n,r,0,e,1,o,0,t,i,1,0,0,0,0,1),this}compose(e,t,n){let i=this.elements,r=t._x,o=t._y,a=t._z,l=t._w,c=r+r,h=o+o,u=a+a,d=r*c,f=r*h,g=r*u,y=o*h,p=o*u,m=a*u,b=l*c,E=l*h,M=l*u,R=n.x,T=n.y,x=n.z;return i[0]=(1-(y+m))*R,i[1]=(f+M)*R,i[2]=(g-E)*R,i[3]=0,i[4]=(f-M)*T,i[5]=(1-(d+m))*T,i[6]=(p+b)*T,i[7]=0,i[8]=(g+E)*x,i[9]=(p-b)*x,i[10]=(1-(d+y))*x,i[11]=0,i[12]=e.x,i[13]=e.y,i[14]=e.z,i[15]=1,this}decompose(e,t,n){let i=this.elements;e.x=i[12],e.y=i[13],e.z=i[14];let r=this.determinantAffine();if(r===0)return n.set(1,1,1),t.identity(),this;let o=Fs.set(i[0],i[1],i[2]).length(),a=Fs.set(i[4],i[5],i[6]).length(),l=Fs.set(i[8],i[9],i[10]).length();r<0&&(o=-o),Un.copy(this);let c=1/o,h=1/a,u=1/l;return Un.elements[0]*=c,Un.elements[1]*=c,Un.elements[2]*=c,Un.elements[4]*=h,Un.elements[5]*=h,Un.elements[6]*=h,Un.elements[8]*=u,Un.elements[9]*=u,Un.elements[10]*=u,t.setFromRotationMatrix(Un),n.x=o,n.y=a,n.z=l,this}makePerspective(e,t,n,i,r,o,a=Pn,l=!1){let c=this.elements,h=2*r/(t-e),u=2*r/(n-i),d=(t+e)/(t-e),f=(n+i)/(n-i),g,y;if(l)g=r/(o-r),y=o*r/(o-r);else if(a===Pn)g=-(o+r)/(o-r),y=-2*o*r/(o-r);else if(a===sr)g=-o/(o-r),y=-o*r/(o-r);else throw new Error("THREE.Matrix4.makePerspective(): Invalid coordinate system: "+a);return c[0]=h,c[4]=0,c[8]=d,c[12]=0,c[1]=0,c[5]=u,c[9]=f,c[13]=0,c[2]=0,c[6]=0,c[10]=g,c[14]=y,c[3]=0,c[7]=0,c[11]=-1,c[15]=0,this}makeOrthographic(e,t,n,i,r,o,a=Pn,l=!1){let c=this.elements,h=2/(t-e),u=2/(n-i),d=-(t+e)/(t-e),f=-(n+i)/(n-i),g,y;if(l)g=1/(o-r),y=o/(o-r);else if(a===Pn)g=-2/(o-r),y=-(o+r)/(o-r);else if(a===sr)g=-1/(o-r),y=-r/(o-r);else throw new Error("THREE.Matrix4.makeOrthographic(): Invalid coordinate system: "+a);return c[0]=h,c[4]=0,c[8]=0,c[12]=d,c[1]=0,c[5]=u,c[9]=0,c[13]=f,c[2]=0,c[6]=0,c[10]=g,c[14]=y,c[3]=0,c[7]=0,c[11]=0,c[15]=1,this}equals(e){let t=this.elements,n=e.elements;for(let i=0;i<16;i++)if(t[i]!==n[i])return!1;return!0}fromArray(e,t=0){for(let n=0;n<16;n++)this.elements[n]=e[n+t];return this}toArray(e=[],t=0){let n=this.elements;return e[t]=n[0],e[t+1]=n[1],e[t+2]=n[2],e[t+3]=n[3],e[t+4]=n[4],e[t+5]=n[5],e[t+6]=n[6],e[t+7]=n[7],e[t+8]=n[8],e[t+9]=n[9],e[t+10]=n[10],e[t+11]=n[11],e[t+12]=n[12],e[t+13]=n[13],e[t+14]=n[14],e[t+15]=n[15],e}},Fs=new S,Un=new _e,E0=new S(0,0,0),R0=new S(1,1,1),Ni=new S,Ko=new S,xn=new S,Jd=new _e,Qd=new De,jn=class s{constructor(e=0,t=0,n=0,i=s.DEFAULT_ORDER){this.isEuler=!0,this._x=e,this._y=t,this._z=n,this._order=i}get x(){return this._x}set x(e){this._x=e,this._onChangeCallback()}get y(){return this._y}set y(e){this._y=e,this._onChangeCallback()}get z(){return this._z}set z(e){this._z=e,this._onChangeCallback()}get order(){return this._order}set order(e){this._order=e,this._onChangeCallback()}set(e,t,n,i=this._order){return this._x=e,this._y=t,this._z=n,this._order=i,this._onChangeCallback(),this}clone(){return new this.constructor(this._x,this._y,this._z,this._order)}copy(e){return this._x=e._x,this._y=e._y,this._z=e._z,this._order=e._order,this._onChangeCallback(),this}setFromRotationMatrix(e,t=this._order,n=!0){let i=e.elements,r=i[0],o=i[4],a=i[8],l=i[1],c=i[5],h=i[9],u=i[2],d=i[6],f=i[10];switch(t){case"XYZ":this._y=Math.asin(qe(a,-1,1)),Math.abs(a)<.9999999?(this._x=Math.atan2(-h,f),this._z=Math.atan2(-o,r)):(this._x=Math.atan2(d,c),this._z=0);break;case"YXZ":this._x=Math.asin(-qe(h,-1,1)),Math.abs(h)<.9999999?(this._y=Math.atan2(a,f),this._z=Math.atan2(l,c)):(this._y=Math.atan2(-u,r),this._z=0);break;case"ZXY":this._x=Math.asin(qe(d,-1,1)),Math.abs(d)<.9999999?(this._y=Math.atan2(-u,f),this._z=Math.atan2(-o,c)):(this._y=0,this._z=Math.atan2(l,r));break;case"ZYX":this._y=Math.asin(-qe(u,-1,1)),Math.abs(u)<.9999999?(this._x=Math.atan2(d,f),this._z=Math.atan2(l,r)):(this._x=0,this._z=Math.atan2(-o,c));break;case"YZX":this._z=Math.asin(qe(l,-1,1)),Math.abs(l)<.9999999?(this._x=Math.atan2(-h,c),this._y=Math.atan2(-u,r)):(this._x=0,this._y=Math.atan2(a,f));break;case"XZY":this._z=Math.asin(-qe(o,-1,1)),Math.abs(o)<.9999999?(this._x=Math.atan2(d,c),this._y=Math.atan2(a,r)):(this._x=Math.atan2(-h,f),this._y=0);break;default:Ee("Euler: .setFromRotationMatrix() encountered an unknown order: "+t)}return this._order=t,n===!0&&this._onChangeCallback(),this}setFromQuaternion(e,t,n){return Jd.makeRotationFromQuaternion(e),this.setFromRotationMatrix(Jd,t,n)}setFromVector3(e,t=this._order){return this.set(e.x,e.y,e.z,t)}reorder(e){return Qd.setFromEuler(this),this.setFromQuaternion(Qd,e)}equals(e){return e._x===this._x&&e._y===this._y&&e._z===this._z&&e._order===this._order}fromArray(e){return this._x=e[0],this._y=e[1],this._z=e[2],e[3]!==void 0&&(this._order=e[3]),this._onChangeCallback(),this}toArray(e=[],t=0){return e[t]=this._x,e[t+1]=this._y,e[t+2]=this._z,e[t+3]=this._order,e}_onChange(e){return this._onChangeCallback=e,this}_onChangeCallback(){}*[Symbol.iterator](){yield this._x,yield this._y,yield this._z,yield this._order}};jn.DEFAULT_ORDER="XYZ";var lr=class{constructor(){this.mask=1}set(e){this.mask=(1<<e|0)>>>0}enable(e){this.mask|=1<<e|0}enableAll(){this.mask=-1}toggle(e){this.mask^=1<<e|0}disable(e){this.mask&=~(1<<e|0)}disableAll(){this.mask=0}test(e){return(this.mask&e.mask)!==0}isEnabled(e){return(this.mask&(1<<e|0))!==0}},C0=0,ef=new S,ks=new De,hi=new _e,jo=new S,Fr=new S,P0=new S,I0=new De,tf=new S(1,0,0),nf=new S(0,1,0),sf=new S(0,0,1),rf={type:"added"},L0={type:"removed"},Bs={type:"childadded",child:null},dh={type:"childremoved",child:null},it=class s extends Bn{constructor(){super(),this.isObject3D=!0,Object.defineProperty(this,"id",{value:C0++}),this.uuid=ni(),this.name="",this.type="Object3D",this.parent=null,this.children=[],this.up=s.DEFAULT_UP.clone();let e=new S,t=new jn,n=new De,i=new S(1,1,1);function r(){n.setFromEuler(t,!1)}function o(){t.setFromQuaternion(n,void 0,!1)}t._onChange(r),n._onChange(o),Object.defineProperties(this,{position:{configurable:!0,enumerable:!0,value:e},rotation:{configurable:!0,enumerable:!0,value:t},quaternion:{configurable:!0,enumerable:!0,value:n},scale:{configurable:!0,enumerable:!0,value:i},modelViewMatrix:{value:new _e},normalMatrix:{value:new Fe}}),this.matrix=new _e,this.matrixWorld=new _e,this.matrixAutoUpdate=s.DEFAULT_MATRIX_AUTO_UPDATE,this.matrixWorldAutoUpdate=s.DEFAULT_MATRIX_WORLD_AUTO_UPDATE,this.matrixWorldNeedsUpdate=!1,this.layers=new lr,this.visible=!0,this.castShadow=!1,this.receiveShadow=!1,this.frustumCulled=!0,this.renderOrder=0,this.animations=[],this.customDepthMaterial=void 0,this.customDistanceMaterial=void 0,this.static=!1,this.userData={},this.pivot=null}onBeforeShadow(){}onAfterShadow(){}onBeforeRender(){}onAfterRender(){}applyMatrix4(e){this.matrixAutoUpdate&&this.updateMatrix(),this.matrix.premultiply(e),this.matrix.decompose(this.position,this.quaternion,this.scale),this.pivot!==null&&this.position.copy(this.pivot).applyMatrix4(this.matrix).sub(this.pivot)}applyQuaternion(e){return this.quaternion.premultiply(e),this}setRotationFromAxisAngle(e,t){this.quaternion.setFromAxisAngle(e,t)}setRotationFromEuler(e){this.quaternion.setFromEuler(e,!0)}setRotationFromMatrix(e){this.quaternion.setFromRotationMatrix(e)}setRotationFromQuaternion(e){this.quaternion.copy(e)}rotateOnAxis(e,t){return ks.setFromAxisAngle(e,t),this.quaternion.multiply(ks),this}rotateOnWorldAxis(e,t){return ks.setFromAxisAngle(e,t),this.quaternion.premultiply(ks),this}rotateX(e){return this.rotateOnAxis(tf,e)}rotateY(e){return this.rotateOnAxis(nf,e)}rotateZ(e){return this.rotateOnAxis(sf,e)}translateOnAxis(e,t){return ef.copy(e).applyQuaternion(this.quaternion),this.position.add(ef.multiplyScalar(t)),this}translateX(e){return this.translateOnAxis(tf,e)}translateY(e){return this.translateOnAxis(nf,e)}translateZ(e){return this.translateOnAxis(sf,e)}localToWorld(e){return this.updateWorldMatrix(!0,!1),e.applyMatrix4(this.matrixWorld)}worldToLocal(e){return this.updateWorldMatrix(!0,!1),e.applyMatrix4(hi.copy(this.matrixWorld).invert())}lookAt(e,t,n){e.isVector3?jo.copy(e):jo.set(e,t,n);let i=this.parent;this.updateWorldMatrix(!0,!1),Fr.setFromMatrixPosition(this.matrixWorld),this.isCamera||this.isLight?hi.lookAt(Fr,jo,this.up):hi.lookAt(jo,Fr,this.up),this.quaternion.setFromRotationMatrix(hi),i&&(hi.extractRotation(i.matrixWorld),ks.setFromRotationMatrix(hi),this.quaternion.premultiply(ks.invert()))}add(e){if(arguments.length>1){for(let t=0;t<arguments.length;t++)this.add(arguments[t]);return this}return e===this?(Oe("Object3D.add: object can't be added as a child of itself.",e),this):(e&&e.isObject3D?(e.removeFromParent(),e.parent=this,this.children.push(e),e.dispatchEvent(rf),Bs.child=e,this.dispatchEvent(Bs),Bs.child=null):Oe("Object3D.add: object not an instance of THREE.Object3D.",e),this)}remove(e){if(arguments.length>1){for(let n=0;n<arguments.length;n++)this.remove(arguments[n]);return this}let t=this.children.indexOf(e);return t!==-1&&(e.parent=null,this.children.splice(t,1),e.dispatchEvent(L0),dh.child=e,this.dispatchEvent(dh),dh.child=null),this}removeFromParent(){let e=this.parent;return e!==null&&e.remove(this),this}clear(){return this.remove(...this.children)}attach(e){return this.updateWorldMatrix(!0,!1),hi.copy(this.matrixWorld).invert(),e.parent!==null&&(e.parent.updateWorldMatrix(!0,!1),hi.multiply(e.parent.matrixWorld)),e.applyMatrix4(hi),e.removeFromParent(),e.parent=this,this.children.push(e),e.updateWorldMatrix(!1,!0),e.dispatchEvent(rf),Bs.child=e,this.dispatchEvent(Bs),Bs.child=null,this}getObjectById(e){return this.getObjectByProperty("id",e)}getObjectByName(e){return this.getObjectByProperty("name",e)}getObjectByProperty(e,t){if(this[e]===t)return this;for(let n=0,i=this.children.length;n<i;n++){let o=this.children[n].getObjectByProperty(e,t);if(o!==void 0)return o}}getObjectsByProperty(e,t,n=[]){this[e]===t&&n.push(this);let i=this.children;for(let r=0,o=i.length;r<o;r++)i[r].getObjectsByProperty(e,t,n);return n}getWorldPosition(e){return this.updateWorldMatrix(!0,!1),e.setFromMatrixPosition(this.matrixWorld)}getWorldQuaternion(e){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(Fr,e,P0),e}getWorldScale(e){return this.updateWorldMatrix(!0,!1),this.matrixWorld.decompose(Fr,I0,e),e}getWorldDirection(e){this.updateWorldMatrix(!0,!1);let t=this.matrixWorld.elements;return e.set(t[8],t[9],t[10]).normalize()}raycast(){}intersectsFrustum(){return!0}traverse(e){e(this);let t=this.children;for(let n=0,i=t.length;n<i;n++)t[n].traverse(e)}traverseVisible(e){if(this.visible===!1)return;e(this);let t=this.children;for(let n=0,i=t.length;n<i;n++)t[n].traverseVisible(e)}traverseAncestors(e){let t=this.parent;t!==null&&(e(t),t.traverseAncestors(e))}updateMatrix(){this.matrix.compose(this.position,this.quaternion,this.scale);let e=this.pivot;if(e!==null){let t=e.x,n=e.y,i=e.z,r=this.matrix.elements;r[12]+=t-r[0]*t-r[4]*n-r[8]*i,r[13]+=n-r[1]*t-r[5]*n-r[9]*i,r[14]+=i-r[2]*t-r[6]*n-r[10]*i}this.matrixWorldNeedsUpdate=!0}updateMatrixWorld(e){this.matrixAutoUpdate&&this.updateMatrix(),(this.matrixWorldNeedsUpdate||e)&&(this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),this.matrixWorldNeedsUpdate=!1,e=!0);let t=this.children;for(let n=0,i=t.length;n<i;n++)t[n].updateMatrixWorld(e)}updateWorldMatrix(e,t,n=!1){let i=this.parent;if(e===!0&&i!==null&&i.updateWorldMatrix(!0,!1),this.matrixAutoUpdate&&this.updateMatrix(),(this.matrixWorldNeedsUpdate||n)&&(this.matrixWorldAutoUpdate===!0&&(this.parent===null?this.matrixWorld.copy(this.matrix):this.matrixWorld.multiplyMatrices(this.parent.matrixWorld,this.matrix)),this.matrixWorldNeedsUpdate=!1,n=!0),t===!0){let r=this.children;for(let o=0,a=r.length;o<a;o++)r[o].updateWorldMatrix(!1,!0,n)}}toJSON(e){let t=e===void 0||typeof e=="string",n={};t&&(e={geometries:{},materials:{},textures:{},images:{},shapes:{},skeletons:{},animations:{},nodes:{}},n.metadata={version:4.7,type:"Object",generator:"Object3D.toJSON"});let i={};i.uuid=this.uuid,i.type=this.type,i.name=this.name,i.castShadow=this.castShadow,i.receiveShadow=this.receiveShadow,i.visible=this.visible,i.frustumCulled=this.frustumCulled,i.renderOrder=this.renderOrder,i.static=this.static,i.matrixAutoUpdate=this.matrixAutoUpdate,Object.keys(this.userData).length>0&&(i.userData=this.userData),i.layers=this.layers.mask,i.matrix=this.matrix.toArray(),i.up=this.up.toArray(),this.pivot!==null&&(i.pivot=this.pivot.toArray()),this.morphTargetDictionary!==void 0&&(i.morphTargetDictionary=Object.assign({},this.morphTargetDictionary)),this.morphTargetInfluences!==void 0&&(i.morphTargetInfluences=this.morphTargetInfluences.slice()),this.isInstancedMesh&&(i.type="InstancedMesh",i.count=this.count,i.instanceMatrix=this.instanceMatrix.toJSON(),this.instanceColor!==null&&(i.instanceColor=this.instanceColor.toJSON())),this.isBatchedMesh&&(i.type="BatchedMesh",i.perObjectFrustumCulled=this.perObjectFrustumCulled,i.sortObjects=this.sortObjects,i.drawRanges=this._drawRanges,i.reservedRanges=this._reservedRanges,i.geometryInfo=this._geometryInfo.map(a=>({...a,boundingBox:a.boundingBox?a.boundingBox.toJSON():void 0,boundingSphere:a.boundingSphere?a.boundingSphere.toJSON():void 0})),i.instanceInfo=this._instanceInfo.map(a=>({...a})),i.availableInstanceIds=this._availableInstanceIds.slice(),i.availableGeometryIds=this._availableGeometryIds.slice(),i.nextIndexStart=this._nextIndexStart,i.nextVertexStart=this._nextVertexStart,i.geometryCount=this._geometryCount,i.maxInstanceCount=this._maxInstanceCount,i.maxVertexCount=this._maxVertexCount,i.maxIndexCount=this._maxIndexCount,i.geometryInitialized=this._geometryInitialized,i.matricesTexture=this._matricesTexture.toJSON(e),i.indirectTexture=this._indirectTexture.toJSON(e),this._colorsTexture!==null&&(i.colorsTexture=this._colorsTexture.toJSON(e)),this.boundingSphere!==null&&(i.boundingSphere=this.boundingSphere.toJSON()),this.boundingBox!==null&&(i.boundingBox=this.boundingBox.toJSON()));function r(a,l){return a[l.uuid]===void 0&&(a[l.uuid]=l.toJSON(e)),l.uuid}if(this.isScene)this.background&&(this.background.isColor?i.background=this.background.toJSON():this.background.isTexture&&(i.background=this.background.toJSON(e).uuid)),this.environment&&this.environment.isTexture&&this.environment.isRenderTargetTexture!==!0&&(i.environment=this.environment.toJSON(e).uuid);else if(this.isMesh||this.isLine||this.isPoints){i.geometry=r(e.geometries,this.geometry);let a=this.geometry.parameters;if(a!==void 0&&a.shapes!==void 0){let l=a.shapes;if(Array.isArray(l))for(let c=0,h=l.length;c<h;c++){let u=l[c];r(e.shapes,u)}else r(e.shapes,l)}}if(this.isSkinnedMesh&&(i.bindMode=this.bindMode,i.bindMatrix=this.bindMatrix.toArray(),this.skeleton!==void 0&&(r(e.skeletons,this.skeleton),i.skeleton=this.skeleton.uuid)),this.material!==void 0)if(Array.isArray(this.material)){let a=[];for(let l=0,c=this.material.length;l<c;l++)a.push(r(e.materials,this.material[l]));i.material=a}else i.material=r(e.materials,this.material);if(this.children.length>0){i.children=[];for(let a=0;a<this.children.length;a++)i.children.push(this.children[a].toJSON(e).object)}if(this.animations.length>0){i.animations=[];for(let a=0;a<this.animations.length;a++){let l=this.animations[a];i.animations.push(r(e.animations,l))}}if(t){let a=o(e.geometries),l=o(e.materials),c=o(e.textures),h=o(e.images),u=o(e.shapes),d=o(e.skeletons),f=o(e.animations),g=o(e.nodes);a.length>0&&(n.geometries=a),l.length>0&&(n.materials=l),c.length>0&&(n.textures=c),h.length>0&&(n.images=h),u.length>0&&(n.shapes=u),d.length>0&&(n.skeletons=d),f.length>0&&(n.animations=f),g.length>0&&(n.nodes=g)}return n.object=i,n;function o(a){let l=[];for(let c in a){let h=a[c];delete h.metadata,l.push(h)}return l}}clone(e){return new this.constructor().copy(this,e)}copy(e,t=!0){if(this.name=e.name,this.up.copy(e.up),this.position.copy(e.position),this.rotation.order=e.rotation.order,this.quaternion.copy(e.quaternion),this.scale.copy(e.scale),this.pivot=e.pivot!==null?e.pivot.clone():null,this.matrix.copy(e.matrix),this.matrixWorld.copy(e.matrixWorld),this.matrixAutoUpdate=e.matrixAutoUpdate,this.matrixWorldAutoUpdate=e.matrixWorldAutoUpdate,this.matrixWorldNeedsUpdate=e.matrixWorldNeedsUpdate,this.layers.mask=e.layers.mask,this.visible=e.visible,this.castShadow=e.castShadow,this.receiveShadow=e.receiveShadow,this.frustumCulled=e.frustumCulled,this.renderOrder=e.renderOrder,this.static=e.static,this.animations=e.animations.slice(),this.userData=JSON.parse(JSON.stringify(e.userData)),t===!0)for(let n=0;n<e.children.length;n++){let i=e.children[n];this.add(i.clone())}return this}dispose(){this.dispatchEvent({type:"dispose"})}};it.DEFAULT_UP=new S(0,1,0);it.DEFAULT_MATRIX_AUTO_UPDATE=!0;it.DEFAULT_MATRIX_WORLD_AUTO_UPDATE=!0;var Pe=class extends it{constructor(){super(),this.isGroup=!0,this.type="Group"}},D0={type:"move"},cr=class{constructor(){this._targetRay=null,this._grip=null,this._hand=null}getHandSpace(){return this._hand===null&&(this._hand=new Pe,this._hand.matrixAutoUpdate=!1,this._hand.visible=!1,this._hand.joints={},this._hand.inputState={pinching:!1}),this._hand}getTargetRaySpace(){return this._targetRay===null&&(this._targetRay=new Pe,this._targetRay.matrixAutoUpdate=!1,this._targetRay.visible=!1,this._targetRay.hasLinearVelocity=!1,this._targetRay.linearVelocity=new S,this._targetRay.hasAngularVelocity=!1,this._targetRay.angularVelocity=new S),this._targetRay}getGripSpace(){return this._grip===null&&(this._grip=new Pe,this._grip.matrixAutoUpdate=!1,this._grip.visible=!1,this._grip.hasLinearVelocity=!1,this._grip.linearVelocity=new S,this._grip.hasAngularVelocity=!1,this._grip.angularVelocity=new S,this._grip.eventsEnabled=!1),this._grip}dispatchEvent(e){return this._targetRay!==null&&this._targetRay.dispatchEvent(e),this._grip!==null&&this._grip.dispatchEvent(e),this._hand!==null&&this._hand.dispatchEvent(e),this}connect(e){if(e&&e.hand){let t=this._hand;if(t)for(let n of e.hand.values())this._getHandJoint(t,n)}return this.dispatchEvent({type:"connected",data:e}),this}disconnect(e){return this.dispatchEvent({type:"disconnected",data:e}),this._targetRay!==null&&(this._targetRay.visible=!1),this._grip!==null&&(this._grip.visible=!1),this._hand!==null&&(this._hand.visible=!1),this}update(e,t,n){let i=null,r=null,o=null,a=this._targetRay,l=this._grip,c=this._hand;if(e&&t.session.visibilityState!=="visible-blurred"){if(c&&e.hand){o=!0;for(let y of e.hand.values()){let p=t.getJointPose(y,n),m=this._getHandJoint(c,y);p!==null&&(m.matrix.fromArray(p.transform.matrix),m.matrix.decompose(m.position,m.quaternion,m.scale),m.matrixWorldNeedsUpdate=!0,m.jointRadius=p.radius),m.visible=p!==null}let h=c.joints["index-finger-tip"],u=c.joints["thumb-tip"],d=h.position.distanceTo(u.position),f=.02,g=.005;c.inputState.pinching&&d>f+g?(c.inputState.pinching=!1,this.dispatchEvent({type:"pinchend",handedness:e.handedness,target:this})):!c.inputState.pinching&&d<=f-g&&(c.inputState.pinching=!0,this.dispatchEvent({type:"pinchstart",handedness:e.handedness,target:this}))}else l!==null&&e.gripSpace&&(r=t.getPose(e.gripSpace,n),r!==null&&(l.matrix.fromArray(r.transform.matrix),l.matrix.decompose(l.position,l.quaternion,l.scale),l.matrixWorldNeedsUpdate=!0,r.linearVelocity?(l.hasLinearVelocity=!0,l.linearVelocity.copy(r.linearVelocity)):l.hasLinearVelocity=!1,r.angularVelocity?(l.hasAngularVelocity=!0,l.angularVelocity.copy(r.angularVelocity)):l.hasAngularVelocity=!1,l.eventsEnabled&&l.dispatchEvent({type:"gripUpdated",data:e,target:this})));a!==null&&(i=t.getPose(e.targetRaySpace,n),i===null&&r!==null&&(i=r),i!==null&&(a.matrix.fromArray(i.transform.matrix),a.matrix.decompose(a.position,a.quaternion,a.scale),a.matrixWorldNeedsUpdate=!0,i.linearVelocity?(a.hasLinearVelocity=!0,a.linearVelocity.copy(i.linearVelocity)):a.hasLinearVelocity=!1,i.angularVelocity?(a.hasAngularVelocity=!0,a.angularVelocity.copy(i.angularVelocity)):a.hasAngularVelocity=!1,this.dispatchEvent(D0)))}return a!==null&&(a.visible=i!==null),l!==null&&(l.visible=r!==null),c!==null&&(c.visible=o!==null),this}_getHandJoint(e,t){if(e.joints[t.jointName]===void 0){let n=new Pe;n.matrixAutoUpdate=!1,n.visible=!1,e.joints[t.jointName]=n,e.add(n)}return e.joints[t.jointName]}},Mp={aliceblue:15792383,antiquewhite:16444375,aqua:65535,aquamarine:8388564,azure:15794175,beige:16119260,bisque:16770244,black:0,blanchedalmond:16772045,blue:255,blueviolet:9055202,brown:10824234,burlywood:14596231,cadetblue:6266528,chartreuse:8388352,chocolate:13789470,coral:16744272,cornflowerblue:6591981,cornsilk:16775388,crimson:14423100,cyan:65535,darkblue:139,darkcyan:35723,darkgoldenrod:12092939,darkgray:11119017,darkgreen:25600,darkgrey:11119017,darkkhaki:12433259,darkmagenta:9109643,darkolivegreen:5597999,darkorange:16747520,darkorchid:10040012,darkred:9109504,darksalmon:15308410,darkseagreen:9419919,darkslateblue:4734347,darkslategray:3100495,darkslategrey:3100495,darkturquoise:52945,darkviolet:9699539,deeppink:16716947,deepskyblue:49151,dimgray:6908265,dimgrey:6908265,dodgerblue:2003199,firebrick:11674146,floralwhite:16775920,forestgreen:2263842,fuchsia:16711935,gainsboro:14474460,ghostwhite:16316671,gold:16766720,goldenrod:14329120,gray:8421504,green:32768,greenyellow:11403055,grey:8421504,honeydew:15794160,hotpink:16738740,indianred:13458524,indigo:4915330,ivory:16777200,khaki:15787660,lavender:15132410,lavenderblush:16773365,lawngreen:8190976,lemonchiffon:16775885,lightblue:11393254,lightcoral:15761536,lightcyan:14745599,lightgoldenrodyellow:16448210,lightgray:13882323,lightgreen:9498256,lightgrey:13882323,lightpink:16758465,lightsalmon:16752762,lightseagreen:2142890,lightskyblue:8900346,lightslategray:7833753,lightslategrey:7833753,lightsteelblue:11584734,lightyellow:16777184,lime:65280,limegreen:3329330,linen:16445670,magenta:16711935,maroon:8388608,mediumaquamarine:6737322,mediumblue:205,mediumorchid:12211667,mediumpurple:9662683,mediumseagreen:3978097,mediumslateblue:8087790,mediumspringgreen:64154,mediumturquoise:4772300,mediumvioletred:13047173,midnightblue:1644912,mintcream:16121850,mistyrose:16770273,moccasin:16770229,navajowhite:16768685,navy:128,oldlace:16643558,olive:8421376,olivedrab:7048739,orange:16753920,orangered:16729344,orchid:14315734,palegoldenrod:15657130,palegreen:10025880,paleturquoise:11529966,palevioletred:14381203,papayawhip:16773077,peachpuff:16767673,peru:13468991,pink:16761035,plum:14524637,powderblue:11591910,purple:8388736,rebeccapurple:6697881,red:16711680,rosybrown:12357519,royalblue:4286945,saddlebrown:9127187,salmon:16416882,sandybrown:16032864,seagreen:3050327,seashell:16774638,sienna:10506797,silver:12632256,skyblue:8900331,slateblue:6970061,slategray:7372944,slategrey:7372944,snow:16775930,springgreen:65407,steelblue:4620980,tan:13808780,teal:32896,thistle:14204888,tomato:16737095,turquoise:4251856,violet:15631086,wheat:16113331,white:16777215,whitesmoke:16119285,yellow:16776960,yellowgreen:10145074},Oi={h:0,s:0,l:0},Zo={h:0,s:0,l:0};function fh(s,e,t){return t<0&&(t+=1),t>1&&(t-=1),t<1/6?s+(e-s)*6*t:t<1/2?e:t<2/3?s+(e-s)*6*(2/3-t):s}var ve=class{constructor(e,t,n){return this.isColor=!0,this.r=1,this.g=1,this.b=1,this.set(e,t,n)}set(e,t,n){if(t===void 0&&n===void 0){let i=e;i&&i.isColor?this.copy(i):typeof i=="number"?this.setHex(i):typeof i=="string"&&this.setStyle(i)}else this.setRGB(e,t,n);return this}setScalar(e){return this.r=e,this.g=e,this.b=e,this}setHex(e,t=ot){return e=Math.floor(e),this.r=(e>>16&255)/255,this.g=(e>>8&255)/255,this.b=(e&255)/255,Xe.colorSpaceToWorking(this,t),this}setRGB(e,t,n,i=Xe.workingColorSpace){return this.r=e,this.g=t,this.b=n,Xe.colorSpaceToWorking(this,i),this}setHSL(e,t,n,i=Xe.workingColorSpace){if(e=vu(e,1),t=qe(t,0,1),n=qe(n,0,1),t===0)this.r=this.g=this.b=n;else{let r=n<=.5?n*(1+t):n+t-n*t,o=2*n-r;this.r=fh(o,r,e+1/3),this.g=fh(o,r,e),this.b=fh(o,r,e-1/3)}return Xe.colorSpaceToWorking(this,i),this}setStyle(e,t=ot){function n(r){r!==void 0&&parseFloat(r)<1&&Ee("Color: Alpha component of "+e+" will be ignored.")}let i;if(i=/^(\w+)\(([^\)]*)\)/.exec(e)){let r,o=i[1],a=i[2];switch(o){case"rgb":case"rgba":if(r=/^\s*(\d+)\s*,\s*(\d+)\s*,\s*(\d+)\s*(?:,\s*(\d+(?:\.\d+)?|\.\d+)\s*)?$/.exec(a))return n(r[4]),this.setRGB(Math.min(255,parseInt(r[1],10))/255,Math.min(255,parseInt(r[2],10))/255,Math.min(255,parseInt(r[3],10))/255,t);if(r=/^\s*(\d+(?:\.\d+)?|\.\d+)\%\s*,\s*(\d+(?:\.\d+)?|\.\d+)\%\s*,\s*(\d+(?:\.\d+)?|\.\d+)\%\s*(?:,\s*(\d+(?:\.\d+)?|\.\d+)\s*)?$/.exec(a))return n(r[4]),this.setRGB(Math.min(100,parseFloat(r[1]))/100,Math.min(100,parseFloat(r[2]))/100,Math.min(100,parseFloat(r[3]))/100,t);break;case"hsl":case"hsla":if(r=/^\s*([+-]?(?:\d+(?:\.\d+)?|\.\d+))\s*,\s*(\d+(?:\.\d+)?|\.\d+)\%\s*,\s*(\d+(?:\.\d+)?|\.\d+)\%\s*(?:,\s*(\d+(?:\.\d+)?|\.\d+)\s*)?$/.exec(a))return n(r[4]),this.setHSL(parseFloat(r[1])/360,parseFloat(r[2])/100,parseFloat(r[3])/100,t);break;default:Ee("Color: Unknown color model "+e)}}else if(i=/^\#([A-Fa-f\d]+)$/.exec(e)){let r=i[1],o=r.length;if(o===3)return this.setRGB(parseInt(r.charAt(0),16)/15,parseInt(r.charAt(1),16)/15,parseInt(r.charAt(2),16)/15,t);if(o===6)return this.setHex(parseInt(r,16),t);Ee("Color: Invalid hex color "+e)}else if(e&&e.length>0)return this.setColorName(e,t);return this}setColorName(e,t=ot){let n=Mp[e.toLowerCase()];return n!==void 0?this.setHex(n,t):Ee("Color: Unknown color "+e),this}clone(){return new this.constructor(this.r,this.g,this.b)}copy(e){return this.r=e.r,this.g=e.g,this.b=e.b,this}copySRGBToLinear(e){return this.r=gi(e.r),this.g=gi(e.g),this.b=gi(e.b),this}copyLinearToSRGB(e){return this.r=tr(e.r),this.g=tr(e.g),this.b=tr(e.b),this}convertSRGBToLinear(){return this.copySRGBToLinear(this),this}convertLinearToSRGB(){return this.copyLinearToSRGB(this),this}getHex(e=ot){return Xe.workingToColorSpace(en.copy(this),e),Math.round(qe(en.r*255,0,255))*65536+Math.round(qe(en.g*255,0,255))*256+Math.round(qe(en.b*255,0,255))}getHexString(e=ot){return("000000"+this.getHex(e).toString(16)).slice(-6)}getHSL(e,t=Xe.workingColorSpace){Xe.workingToColorSpace(en.copy(this),t);let n=en.r,i=en.g,r=en.b,o=Math.max(n,i,r),a=Math.min(n,i,r),l,c,h=(a+o)/2;if(a===o)l=0,c=0;else{let u=o-a;switch(c=h<=.5?u/(o+a):u/(2-o-a),o){case n:l=(i-r)/u+(i<r?6:0);break;case i:l=(r-n)/u+2;break;case r:l=(n-i)/u+4;break}l/=6}return e.h=l,e.s=c,e.l=h,e}getRGB(e,t=Xe.workingColorSpace){return Xe.workingToColorSpace(en.copy(this),t),e.r=en.r,e.g=en.g,e.b=en.b,e}getStyle(e=ot){Xe.workingToColorSpace(en.copy(this),e);let t=en.r,n=en.g,i=en.b;return e!==ot?`color(${e} ${t.toFixed(3)} ${n.toFixed(3)} ${i.toFixed(3)})`:`rgb(${Math.round(t*255)},${Math.round(n*255)},${Math.round(i*255)})`}offsetHSL(e,t,n){return this.getHSL(Oi),this.setHSL(Oi.h+e,Oi.s+t,Oi.l+n)}add(e){return this.r+=e.r,this.g+=e.g,this.b+=e.b,this}addColors(e,t){return this.r=e.r+t.r,this.g=e.g+t.g,this.b=e.b+t.b,this}addScalar(e){return this.r+=e,this.g+=e,this.b+=e,this}sub(e){return this.r=Math.max(0,this.r-e.r),this.g=Math.max(0,this.g-e.g),this.b=Math.max(0,this.b-e.b),this}multiply(e){return this.r*=e.r,this.g*=e.g,this.b*=e.b,this}multiplyScalar(e){return this.r*=e,this.g*=e,this.b*=e,this}lerp(e,t){return this.r+=(e.r-this.r)*t,this.g+=(e.g-this.g)*t,this.b+=(e.b-this.b)*t,this}lerpColors(e,t,n){return this.r=e.r+(t.r-e.r)*n,this.g=e.g+(t.g-e.g)*n,this.b=e.b+(t.b-e.b)*n,this}lerpHSL(e,t){this.getHSL(Oi),e.getHSL(Zo);let n=Kr(Oi.h,Zo.h,t),i=Kr(Oi.s,Zo.s,t),r=Kr(Oi.l,Zo.l,t);return this.setHSL(n,i,r),this}setFromVector3(e){return this.r=e.x,this.g=e.y,this.b=e.z,this}applyMatrix3(e){let t=this.r,n=this.g,i=this.b,r=e.elements;return this.r=r[0]*t+r[3]*n+r[6]*i,this.g=r[1]*t+r[4]*n+r[7]*i,this.b=r[2]*t+r[5]*n+r[8]*i,this}equals(e){return e.r===this.r&&e.g===this.g&&e.b===this.b}fromArray(e,t=0){return this.r=e[t],this.g=e[t+1],this.b=e[t+2],this}toArray(e=[],t=0){return e[t]=this.r,e[t+1]=this.g,e[t+2]=this.b,e}fromBufferAttribute(e,t){return this.r=e.getX(t),this.g=e.getY(t),this.b=e.getZ(t),this}toJSON(){return this.getHex()}*[Symbol.iterator](){yield this.r,yield this.g,yield this.b}},en=new ve;ve.NAMES=Mp;var yi=class extends it{constructor(){super(),this.isScene=!0,this.type="Scene",this.background=null,this.environment=null,this.fog=null,this.backgroundBlurriness=0,this.backgroundIntensity=1,this.backgroundRotation=new jn,this.environmentIntensity=1,this.environmentRotation=new jn,this.overrideMaterial=null,typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}copy(e,t){return super.copy(e,t),this.background=e.background!==null?e.background.clone():null,this.environment=e.environment!==null?e.environment.clone():null,this.fog=e.fog!==null?e.fog.clone():null,this.backgroundBlurriness=e.backgroundBlurriness,this.backgroundIntensity=e.backgroundIntensity,this.backgroundRotation.copy(e.backgroundRotation),this.environmentIntensity=e.environmentIntensity,this.environmentRotation.copy(e.environmentRotation),this.overrideMaterial=e.overrideMaterial!==null?e.overrideMaterial.clone():null,this.matrixAutoUpdate=e.matrixAutoUpdate,this}toJSON(e){let t=super.toJSON(e);return this.fog!==null&&(t.object.fog=this.fog.toJSON()),t.object.backgroundBlurriness=this.backgroundBlurriness,t.object.backgroundIntensity=this.backgroundIntensity,t.object.backgroundRotation=this.backgroundRotation.toArray(),t.object.environmentIntensity=this.environmentIntensity,t.object.environmentRotation=this.environmentRotation.toArray(),t}},Fn=new S,ui=new S,ph=new S,di=new S,zs=new S,Hs=new S,of=new S,mh=new S,gh=new S,xh=new S,yh=new at,vh=new at,_h=new at,Yn=class s{constructor(e=new S,t=new S,n=new S){this.a=e,this.b=t,this.c=n}static getNormal(e,t,n,i){i.subVectors(n,t),Fn.subVectors(e,t),i.cross(Fn);let r=i.lengthSq();return r>0?i.multiplyScalar(1/Math.sqrt(r)):i.set(0,0,0)}static getBarycoord(e,t,n,i,r){Fn.subVectors(i,t),ui.subVectors(n,t),ph.subVectors(e,t);let o=Fn.dot(Fn),a=Fn.dot(ui),l=Fn.dot(ph),c=ui.dot(ui),h=ui.dot(ph),u=o*c-a*a;if(u===0)return r.set(0,0,0),null;let d=1/u,f=(c*l-a*h)*d,g=(o*h-a*l)*d;return r.set(1-f-g,g,f)}static containsPoint(e,t,n,i){return this.getBarycoord(e,t,n,i,di)===null?!1:di.x>=0&&di.y>=0&&di.x+di.y<=1}static getInterpolation(e,t,n,i,r,o,a,l){return this.getBarycoord(e,t,n,i,di)===null?(l.x=0,l.y=0,"z"in l&&(l.z=0),"w"in l&&(l.w=0),null):(l.setScalar(0),l.addScaledVector(r,di.x),l.addScaledVector(o,di.y),l.addScaledVector(a,di.z),l)}static getInterpolatedAttribute(e,t,n,i,r,o){return yh.setScalar(0),vh.setScalar(0),_h.setScalar(0),yh.fromBufferAttribute(e,t),vh.fromBufferAttribute(e,n),_h.fromBufferAttribute(e,i),o.setScalar(0),o.addScaledVector(yh,r.x),o.addScaledVector(vh,r.y),o.addScaledVector(_h,r.z),o}static isFrontFacing(e,t,n,i){return Fn.subVectors(n,t),ui.subVectors(e,t),Fn.cross(ui).dot(i)<0}set(e,t,n){return this.a.copy(e),this.b.copy(t),this.c.copy(n),this}setFromPointsAndIndices(e,t,n,i){return this.a.copy(e[t]),this.b.copy(e[n]),this.c.copy(e[i]),this}setFromAttributeAndIndices(e,t,n,i){return this.a.fromBufferAttribute(e,t),this.b.fromBufferAttribute(e,n),this.c.fromBufferAttribute(e,i),this}clone(){return new this.constructor().copy(this)}copy(e){return this.a.copy(e.a),this.b.copy(e.b),this.c.copy(e.c),this}getArea(){return Fn.subVectors(this.c,this.b),ui.subVectors(this.a,this.b),Fn.cross(ui).length()*.5}getMidpoint(e){return e.addVectors(this.a,this.b).add(this.c).multiplyScalar(1/3)}getNormal(e){return s.getNormal(this.a,this.b,this.c,e)}getPlane(e){return e.setFromCoplanarPoints(this.a,this.b,this.c)}getBarycoord(e,t){return s.getBarycoord(e,this.a,this.b,this.c,t)}getInterpolation(e,t,n,i,r){return s.getInterpolation(e,this.a,this.b,this.c,t,n,i,r)}containsPoint(e){return s.containsPoint(e,this.a,this.b,this.c)}isFrontFacing(e){return s.isFrontFacing(this.a,this.b,this.c,e)}intersectsBox(e){return e.intersectsTriangle(this)}closestPointToPoint(e,t){let n=this.a,i=this.b,r=this.c,o,a;zs.subVectors(i,n),Hs.subVectors(r,n),mh.subVectors(e,n);let l=zs.dot(mh),c=Hs.dot(mh);if(l<=0&&c<=0)return t.copy(n);gh.subVectors(e,i);let h=zs.dot(gh),u=Hs.dot(gh);if(h>=0&&u<=h)return t.copy(i);let d=l*u-h*c;if(d<=0&&l>=0&&h<=0&&l-h>0)return o=l/(l-h),t.copy(n).addScaledVector(zs,o);xh.subVectors(e,r);let f=zs.dot(xh),g=Hs.dot(xh);if(g>=0&&f<=g)return t.copy(r);let y=f*c-l*g;if(y<=0&&c>=0&&g<=0)return a=c/(c-g),t.copy(n).addScaledVector(Hs,a);let p=h*g-f*u;if(p<=0&&u-h>=0&&f-g>=0)return of.subVectors(r,i),a=(u-h)/(u-h+(f-g)),t.copy(i).addScaledVector(of,a);let m=1/(p+y+d);return o=y*m,a=d*m,t.copy(n).addScaledVector(zs,o).addScaledVector(Hs,a)}equals(e){return e.a.equals(this.a)&&e.b.equals(this.b)&&e.c.equals(this.c)}},vt=class{constructor(e=new S(1/0,1/0,1/0),t=new S(-1/0,-1/0,-1/0)){this.isBox3=!0,this.min=e,this.max=t}set(e,t){return this.min.copy(e),this.max.copy(t),this}setFromArray(e){this.makeEmpty();for(let t=0,n=e.length;t<n;t+=3)this.expandByPoint(kn.fromArray(e,t));return this}setFromBufferAttribute(e){this.makeEmpty();for(let t=0,n=e.count;t<n;t++)this.expandByPoint(kn.fromBufferAttribute(e,t));return this}setFromPoints(e){this.makeEmpty();for(let t=0,n=e.length;t<n;t++)this.expandByPoint(e[t]);return this}setFromCenterAndSize(e,t){let n=kn.copy(t).multiplyScalar(.5);return this.min.copy(e).sub(n),this.max.copy(e).add(n),this}setFromObject(e,t=!1){return this.makeEmpty(),this.expandByObject(e,t)}clone(){return new this.constructor().copy(this)}copy(e){return this.min.copy(e.min),this.max.copy(e.max),this}makeEmpty(){return this.min.x=this.min.y=this.min.z=1/0,this.max.x=this.max.y=this.max.z=-1/0,this}isEmpty(){return this.max.x<this.min.x||this.max.y<this.min.y||this.max.z<this.min.z}getCenter(e){return this.isEmpty()?e.set(0,0,0):e.addVectors(this.min,this.max).multiplyScalar(.5)}getSize(e){return this.isEmpty()?e.set(0,0,0):e.subVectors(this.max,this.min)}expandByPoint(e){return this.min.min(e),this.max.max(e),this}expandByVector(e){return this.min.sub(e),this.max.add(e),this}expandByScalar(e){return this.min.addScalar(-e),this.max.addScalar(e),this}expandByObject(e,t=!1){e.updateWorldMatrix(!1,!1);let n=e.geometry;if(n!==void 0){let r=n.getAttribute("position");if(t===!0&&r!==void 0&&e.isInstancedMesh!==!0&&e.isBatchedMesh!==!0)for(let o=0,a=r.count;o<a;o++)e.isMesh===!0?e.getVertexPosition(o,kn):kn.fromBufferAttribute(r,o),kn.applyMatrix4(e.matrixWorld),this.expandByPoint(kn);else e.boundingBox!==void 0?(e.boundingBox===null&&e.computeBoundingBox(),Jo.copy(e.boundingBox)):(n.boundingBox===null&&n.computeBoundingBox(),Jo.copy(n.boundingBox)),Jo.applyMatrix4(e.matrixWorld),this.union(Jo)}let i=e.children;for(let r=0,o=i.length;r<o;r++)this.expandByObject(i[r],t);return this}containsPoint(e){return e.x>=this.min.x&&e.x<=this.max.x&&e.y>=this.min.y&&e.y<=this.max.y&&e.z>=this.min.z&&e.z<=this.max.z}containsBox(e){return this.min.x<=e.min.x&&e.max.x<=this.max.x&&this.min.y<=e.min.y&&e.max.y<=this.max.y&&this.min.z<=e.min.z&&e.max.z<=this.max.z}getParameter(e,t){return t.set((e.x-this.min.x)/(this.max.x-this.min.x),(e.y-this.min.y)/(this.max.y-this.min.y),(e.z-this.min.z)/(this.max.z-this.min.z))}intersectsBox(e){return e.max.x>=this.min.x&&e.min.x<=this.max.x&&e.max.y>=this.min.y&&e.min.y<=this.max.y&&e.max.z>=this.min.z&&e.min.z<=this.max.z}intersectsSphere(e){return this.clampPoint(e.center,kn),kn.distanceToSquared(e.center)<=e.radius*e.radius}intersectsPlane(e){let t,n;return e.normal.x>0?(t=e.normal.x*this.min.x,n=e.normal.x*this.max.x):(t=e.normal.x*this.max.x,n=e.normal.x*this.min.x),e.normal.y>0?(t+=e.normal.y*this.min.y,n+=e.normal.y*this.max.y):(t+=e.normal.y*this.max.y,n+=e.normal.y*this.min.y),e.normal.z>0?(t+=e.normal.z*this.min.z,n+=e.normal.z*this.max.z):(t+=e.normal.z*this.max.z,n+=e.normal.z*this.min.z),t<=-e.constant&&n>=-e.constant}intersectsTriangle(e){if(this.isEmpty())return!1;this.getCenter(kr),Qo.subVectors(this.max,kr),Gs.subVectors(e.a,kr),Vs.subVectors(e.b,kr),Ws.subVectors(e.c,kr),Ui.subVectors(Vs,Gs),Fi.subVectors(Ws,Vs),os.subVectors(Gs,Ws);let t=[0,-Ui.z,Ui.y,0,-Fi.z,Fi.y,0,-os.z,os.y,Ui.z,0,-Ui.x,Fi.z,0,-Fi.x,os.z,0,-os.x,-Ui.y,Ui.x,0,-Fi.y,Fi.x,0,-os.y,os.x,0];return!bh(t,Gs,Vs,Ws,Qo)||(t=[1,0,0,0,1,0,0,0,1],!bh(t,Gs,Vs,Ws,Qo))?!1:(ea.crossVectors(Ui,Fi),t=[ea.x,ea.y,ea.z],bh(t,Gs,Vs,Ws,Qo))}clampPoint(e,t){return t.copy(e).clamp(this.min,this.max)}distanceToPoint(e){return this.clampPoint(e,kn).distanceTo(e)}getBoundingSphere(e){return this.isEmpty()?e.makeEmpty():(this.getCenter(e.center),e.radius=this.getSize(kn).length()*.5),e}intersect(e){return this.min.max(e.min),this.max.min(e.max),this.isEmpty()&&this.makeEmpty(),this}union(e){return this.min.min(e.min),this.max.max(e.max),this}applyMatrix4(e){return this.isEmpty()?this:(fi[0].set(this.min.x,this.min.y,this.min.z).applyMatrix4(e),fi[1].set(this.min.x,this.min.y,this.max.z).applyMatrix4(e),fi[2].set(this.min.x,this.max.y,this.min.z).applyMatrix4(e),fi[3].set(this.min.x,this.max.y,this.max.z).applyMatrix4(e),fi[4].set(this.max.x,this.min.y,this.min.z).applyMatrix4(e),fi[5].set(this.max.x,this.min.y,this.max.z).applyMatrix4(e),fi[6].set(this.max.x,this.max.y,this.min.z).applyMatrix4(e),fi[7].set(this.max.x,this.max.y,this.max.z).applyMatrix4(e),this.setFromPoints(fi),this)}translate(e){return this.min.add(e),this.max.add(e),this}equals(e){return e.min.equals(this.min)&&e.max.equals(this.max)}toJSON(){return{min:this.min.toArray(),max:this.max.toArray()}}fromJSON(e){return this.min.fromArray(e.min),this.max.fromArray(e.max),this}},fi=[new S,new S,new S,new S,new S,new S,new S,new S],kn=new S,Jo=new vt,Gs=new S,Vs=new S,Ws=new S,Ui=new S,Fi=new S,os=new S,kr=new S,Qo=new S,ea=new S,as=new S;function bh(s,e,t,n,i){for(let r=0,o=s.length-3;r<=o;r+=3){as.fromArray(s,r);let a=i.x*Math.abs(as.x)+i.y*Math.abs(as.y)+i.z*Math.abs(as.z),l=e.dot(as),c=t.dot(as),h=n.dot(as);if(Math.max(-Math.max(l,c,h),Math.min(l,c,h))>a)return!1}return!0}var Pt=new S,ta=new ye,N0=0,bt=class extends Bn{constructor(e,t,n=!1){if(super(),Array.isArray(e))throw new TypeError("THREE.BufferAttribute: array should be a Typed Array.");this.isBufferAttribute=!0,Object.defineProperty(this,"id",{value:N0++}),this.name="",this.array=e,this.itemSize=t,this.count=e!==void 0?e.length/t:0,this.normalized=n,this.usage=xu,this.updateRanges=[],this.gpuType=_n,this.version=0,this._normalizationScale=e!==void 0?Bl(e):void 0}onUploadCallback(){}set needsUpdate(e){e===!0&&this.version++}setUsage(e){return this.usage=e,this}addUpdateRange(e,t){this.updateRanges.push({start:e,count:t})}clearUpdateRanges(){this.updateRanges.length=0}copy(e){return this.name=e.name,this.array=new e.array.constructor(e.array),this.itemSize=e.itemSize,this.count=e.count,this.normalized=e.normalized,this.usage=e.usage,this.gpuType=e.gpuType,this._normalizationScale=e._normalizationScale,this}copyAt(e,t,n){e*=this.itemSize,n*=t.itemSize;for(let i=0,r=this.itemSize;i<r;i++)this.array[e+i]=t.array[n+i];return this}copyArray(e){return this.array.set(e),this}applyMatrix3(e){if(this.itemSize===2)for(let t=0,n=this.count;t<n;t++)ta.fromBufferAttribute(this,t),ta.applyMatrix3(e),this.setXY(t,ta.x,ta.y);else if(this.itemSize===3)for(let t=0,n=this.count;t<n;t++)Pt.fromBufferAttribute(this,t),Pt.applyMatrix3(e),this.setXYZ(t,Pt.x,Pt.y,Pt.z);return this}applyMatrix4(e){for(let t=0,n=this.count;t<n;t++)Pt.fromBufferAttribute(this,t),Pt.applyMatrix4(e),this.setXYZ(t,Pt.x,Pt.y,Pt.z);return this}applyNormalMatrix(e){for(let t=0,n=this.count;t<n;t++)Pt.fromBufferAttribute(this,t),Pt.applyNormalMatrix(e),this.setXYZ(t,Pt.x,Pt.y,Pt.z);return this}transformDirection(e){for(let t=0,n=this.count;t<n;t++)Pt.fromBufferAttribute(this,t),Pt.transformDirection(e),this.setXYZ(t,Pt.x,Pt.y,Pt.z);return this}set(e,t=0){return this.array.set(e,t),this}getComponent(e,t){let n=this.array[e*this.itemSize+t];return this.normalized&&(n=this._denormalize(n)),n}setComponent(e,t,n){return this.normalized&&(n=this._normalize(n)),this.array[e*this.itemSize+t]=n,this}getX(e){let t=this.array[e*this.itemSize];return this.normalized&&(t=this._denormalize(t)),t}setX(e,t){return this.normalized&&(t=this._normalize(t)),this.array[e*this.itemSize]=t,this}getY(e){let t=this.array[e*this.itemSize+1];return this.normalized&&(t=this._denormalize(t)),t}setY(e,t){return this.normalized&&(t=this._normalize(t)),this.array[e*this.itemSize+1]=t,this}getZ(e){let t=this.array[e*this.itemSize+2];return this.normalized&&(t=this._denormalize(t)),t}setZ(e,t){return this.normalized&&(t=this._normalize(t)),this.array[e*this.itemSize+2]=t,this}getW(e){let t=this.array[e*this.itemSize+3];return this.normalized&&(t=this._denormalize(t)),t}setW(e,t){return this.normalized&&(t=this._normalize(t)),this.array[e*this.itemSize+3]=t,this}setXY(e,t,n){return e*=this.itemSize,this.normalized&&(t=this._normalize(t),n=this._normalize(n)),this.array[e+0]=t,this.array[e+1]=n,this}setXYZ(e,t,n,i){return e*=this.itemSize,this.normalized&&(t=this._normalize(t),n=this._normalize(n),i=this._normalize(i)),this.array[e+0]=t,this.array[e+1]=n,this.array[e+2]=i,this}setXYZW(e,t,n,i,r){return e*=this.itemSize,this.normalized&&(t=this._normalize(t),n=this._normalize(n),i=this._normalize(i),r=this._normalize(r)),this.array[e+0]=t,this.array[e+1]=n,this.array[e+2]=i,this.array[e+3]=r,this}onUpload(e){return this.onUploadCallback=e,this}clone(){return new this.constructor(this.array,this.itemSize).copy(this)}toJSON(){let e={itemSize:this.itemSize,type:this.array.constructor.name,array:Array.from(this.array),normalized:this.normalized};return e.name=this.name,e.usage=this.usage,e.gpuType=this.gpuType,e}dispose(){this.dispatchEvent({type:"dispose"})}_denormalize(e){let t=this._normalizationScale;return t!==void 0?Math.max(e/t,-1):bu(e,this.array)}_normalize(e){let t=this._normalizationScale;return t!==void 0?Math.round(e*t):Mu(e,this.array)}};var Qr=class extends bt{constructor(e,t,n){super(new Uint16Array(e),t,n)}};var eo=class extends bt{constructor(e,t,n){super(new Uint32Array(e),t,n)}};var Ue=class extends bt{constructor(e,t,n){super(new Float32Array(e),t,n)}},O0=new vt,Br=new S,Mh=new S,un=class{constructor(e=new S,t=-1){this.isSphere=!0,this.center=e,this.radius=t}set(e,t){return this.center.copy(e),this.radius=t,this}setFromPoints(e,t){let n=this.center;t!==void 0?n.copy(t):O0.setFromPoints(e).getCenter(n);let i=0;for(let r=0,o=e.length;r<o;r++)i=Math.max(i,n.distanceToSquared(e[r]));return this.radius=Math.sqrt(i),this}copy(e){return this.center.copy(e.center),this.radius=e.radius,this}isEmpty(){return this.radius<0}makeEmpty(){return this.center.set(0,0,0),this.radius=-1,this}containsPoint(e){return e.distanceToSquared(this.center)<=this.radius*this.radius}distanceToPoint(e){return e.distanceTo(this.center)-this.radius}intersectsSphere(e){let t=this.radius+e.radius;return e.center.distanceToSquared(this.center)<=t*t}intersectsBox(e){return e.intersectsSphere(this)}intersectsPlane(e){return Math.abs(e.distanceToPoint(this.center))<=this.radius}clampPoint(e,t){let n=this.center.distanceToSquared(e);return t.copy(e),n>this.radius*this.radius&&(t.sub(this.center).normalize(),t.multiplyScalar(this.radius).add(this.center)),t}getBoundingBox(e){return this.isEmpty()?(e.makeEmpty(),e):(e.set(this.center,this.center),e.expandByScalar(this.radius),e)}applyMatrix4(e){return this.center.applyMatrix4(e),this.radius=this.radius*e.getMaxScaleOnAxis(),this}translate(e){return this.center.add(e),this}expandByPoint(e){if(this.isEmpty())return this.center.copy(e),this.radius=0,this;Br.subVectors(e,this.center);let t=Br.lengthSq();if(t>this.radius*this.radius){let n=Math.sqrt(t),i=(n-this.radius)*.5;this.center.addScaledVector(Br,i/n),this.radius+=i}return this}union(e){return e.isEmpty()?this:this.isEmpty()?(this.copy(e),this):(this.center.equals(e.center)===!0?this.radius=Math.max(this.radius,e.radius):(Mh.subVectors(e.center,this.center).setLength(e.radius),this.expandByPoint(Br.copy(e.center).add(Mh)),this.expandByPoint(Br.copy(e.center).sub(Mh))),this)}equals(e){return e.center.equals(this.center)&&e.radius===this.radius}clone(){return new this.constructor().copy(this)}toJSON(){return{radius:this.radius,center:this.center.toArray()}}fromJSON(e){return this.radius=e.radius,this.center.fromArray(e.center),this}},U0=0,Rn=new _e,wh=new it,Xs=new S,yn=new vt,zr=new vt,Gt=new S,Ye=class s extends Bn{constructor(){super(),this.isBufferGeometry=!0,Object.defineProperty(this,"id",{value:U0++}),this.uuid=ni(),this.name="",this.type="BufferGeometry",this.index=null,this.indirect=null,this.indirectOffset=0,this.attributes={},this.morphAttributes={},this.morphTargetsRelative=!1,this.groups=[],this.boundingBox=null,this.boundingSphere=null,this.drawRange={start:0,count:1/0},this.userData={},this._transformed=!1}getIndex(){return this.index}setIndex(e){return Array.isArray(e)?this.index=new(a0(e)?eo:Qr)(e,1):this.index=e,this}setIndirect(e,t=0){return this.indirect=e,this.indirectOffset=t,this}getIndirect(){return this.indirect}getAttribute(e){return this.attributes[e]}setAttribute(e,t){return this.attributes[e]=t,this}deleteAttribute(e){return delete this.attributes[e],this}hasAttribute(e){return this.attributes[e]!==void 0}addGroup(e,t,n=0){this.groups.push({start:e,count:t,materialIndex:n})}clearGroups(){this.groups=[]}setDrawRange(e,t){this.drawRange.start=e,this.drawRange.count=t}applyMatrix4(e){let t=this.attributes.position;t!==void 0&&(t.applyMatrix4(e),t.needsUpdate=!0);let n=this.attributes.normal;if(n!==void 0){let r=new Fe().getNormalMatrix(e);n.applyNormalMatrix(r),n.needsUpdate=!0}let i=this.attributes.tangent;return i!==void 0&&(i.transformDirection(e),i.needsUpdate=!0),this.boundingBox!==null&&this.computeBoundingBox(),this.boundingSphere!==null&&this.computeBoundingSphere(),this._transformed=!0,this}applyQuaternion(e){return Rn.makeRotationFromQuaternion(e),this.applyMatrix4(Rn),this}rotateX(e){return Rn.makeRotationX(e),this.applyMatrix4(Rn),this}rotateY(e){return Rn.makeRotationY(e),this.applyMatrix4(Rn),this}rotateZ(e){return Rn.makeRotationZ(e),this.applyMatrix4(Rn),this}translate(e,t,n){return Rn.makeTranslation(e,t,n),this.applyMatrix4(Rn),this}scale(e,t,n){return Rn.makeScale(e,t,n),this.applyMatrix4(Rn),this}lookAt(e){return wh.lookAt(e),wh.updateMatrix(),this.applyMatrix4(wh.matrix),this}center(){return this.computeBoundingBox(),this.boundingBox.getCenter(Xs).negate(),this.translate(Xs.x,Xs.y,Xs.z),this}setFromPoints(e){let t=this.getAttribute("position");if(t===void 0){let n=[];for(let i=0,r=e.length;i<r;i++){let o=e[i];n.push(o.x,o.y,o.z||0)}this.setAttribute("position",new Ue(n,3))}else{let n=Math.min(e.length,t.count);for(let i=0;i<n;i++){let r=e[i];t.setXYZ(i,r.x,r.y,r.z||0)}e.length>t.count&&Ee("BufferGeometry: Buffer size too small for points data. Use .dispose() and create a new geometry."),t.needsUpdate=!0}return this}computeBoundingBox(){this.boundingBox===null&&(this.boundingBox=new vt);let e=this.attributes.position,t=this.morphAttributes.position;if(e&&e.isGLBufferAttribute){Oe("BufferGeometry.computeBoundingBox(): GLBufferAttribute requires a manual bounding box.",this),this.boundingBox.set(new S(-1/0,-1/0,-1/0),new S(1/0,1/0,1/0));return}if(e!==void 0){if(this.boundingBox.setFromBufferAttribute(e),t)for(let n=0,i=t.length;n<i;n++){let r=t[n];yn.setFromBufferAttribute(r),this.morphTargetsRelative?(Gt.addVectors(this.boundingBox.min,yn.min),this.boundingBox.expandByPoint(Gt),Gt.addVectors(this.boundingBox.max,yn.max),this.boundingBox.expandByPoint(Gt)):(this.boundingBox.expandByPoint(yn.min),this.boundingBox.expandByPoint(yn.max))}}else this.boundingBox.makeEmpty();(isNaN(this.boundingBox.min.x)||isNaN(this.boundingBox.min.y)||isNaN(this.boundingBox.min.z))&&Oe('BufferGeometry.computeBoundingBox(): Computed min/max have NaN values. The "position" attribute is likely to have NaN values.',this)}computeBoundingSphere(){this.boundingSphere===null&&(this.boundingSphere=new un);let e=this.attributes.position,t=this.morphAttributes.position;if(e&&e.isGLBufferAttribute){Oe("BufferGeometry.computeBoundingSphere(): GLBufferAttribute requires a manual bounding sphere.",this),this.boundingSphere.set(new S,1/0);return}if(e){let n=this.boundingSphere.center;if(yn.setFromBufferAttribute(e),t)for(let r=0,o=t.length;r<o;r++){let a=t[r];zr.setFromBufferAttribute(a),this.morphTargetsRelative?(Gt.addVectors(yn.min,zr.min),yn.expandByPoint(Gt),Gt.addVectors(yn.max,zr.max),yn.expandByPoint(Gt)):(yn.expandByPoint(zr.min),yn.expandByPoint(zr.max))}yn.getCenter(n);let i=0;for(let r=0,o=e.count;r<o;r++)Gt.fromBufferAttribute(e,r),i=Math.max(i,n.distanceToSquared(Gt));if(t)for(let r=0,o=t.length;r<o;r++){let a=t[r],l=this.morphTargetsRelative;for(let c=0,h=a.count;c<h;c++)Gt.fromBufferAttribute(a,c),l&&(Xs.fromBufferAttribute(e,c),Gt.add(Xs)),i=Math.max(i,n.distanceToSquared(Gt))}this.boundingSphere.radius=Math.sqrt(i),isNaN(this.boundingSphere.radius)&&Oe('BufferGeometry.computeBoundingSphere(): Computed radius is NaN. The "position" attribute is likely to have NaN values.',this)}}computeTangents(){let e=this.index,t=this.attributes;if(e===null||t.position===void 0||t.normal===void 0||t.uv===void 0){Oe("BufferGeometry: .computeTangents() failed. Missing required attributes (index, position, normal or uv)");return}let n=t.position,i=t.normal,r=t.uv,o=this.getAttribute("tangent");(o===void 0||o.count!==n.count)&&(o=new bt(new Float32Array(4*n.count),4),this.setAttribute("tangent",o));let a=[],l=[],c=new Uint8Array(n.count);for(let O=0;O<n.count;O++)a[O]=new S,l[O]=new S;let h=new S,u=new S,d=new S,f=new ye,g=new ye,y=new ye,p=new S,m=new S;function b(O,I,N){c[O]=c[I]=c[N]=1,h.fromBufferAttribute(n,O),u.fromBufferAttribute(n,I),d.fromBufferAttribute(n,N),f.fromBufferAttribute(r,O),g.fromBufferAttribute(r,I),y.fromBufferAttribute(r,N),u.sub(h),d.sub(h),g.sub(f),y.sub(f);let k=1/(g.x*y.y-y.x*g.y);isFinite(k)&&(p.copy(u).multiplyScalar(y.y).addScaledVector(d,-g.y).multiplyScalar(k),m.copy(d).multiplyScalar(g.x).addScaledVector(u,-y.x).multiplyScalar(k),a[O].add(p),a[I].add(p),a[N].add(p),l[O].add(m),l[I].add(m),l[N].add(m))}let E=this.groups;E.length===0&&(E=[{start:0,count:e.count}]);for(let O=0,I=E.length;O<I;++O){let N=E[O],k=N.start,V=N.count;for(let P=k,G=k+V;P<G;P+=3)b(e.getX(P+0),e.getX(P+1),e.getX(P+2))}let M=new S,R=new S,T=new S,x=new S;function w(O){T.fromBufferAttribute(i,O),x.copy(T);let I=a[O];M.copy(I),M.sub(T.multiplyScalar(T.dot(I))).normalize(),R.crossVectors(x,I);let k=R.dot(l[O])<0?-1:1;o.setXYZW(O,M.x,M.y,M.z,k)}for(let O=0,I=n.count;O<I;++O)c[O]&&w(O);this._transformed=!0}computeVertexNormals(){let e=this.index,t=this.getAttribute("position");if(t!==void 0){let n=this.getAttribute("normal");if(n===void 0||n.count!==t.count)n=new bt(new Float32Array(t.count*3),3),this.setAttribute("normal",n);else for(let d=0,f=n.count;d<f;d++)n.setXYZ(d,0,0,0);let i=new S,r=new S,o=new S,a=new S,l=new S,c=new S,h=new S,u=new S;if(e)for(let d=0,f=e.count;d<f;d+=3){let g=e.getX(d+0),y=e.getX(d+1),p=e.getX(d+2);i.fromBufferAttribute(t,g),r.fromBufferAttribute(t,y),o.fromBufferAttribute(t,p),h.subVectors(o,r),u.subVectors(i,r),h.cross(u),a.fromBufferAttribute(n,g),l.fromBufferAttribute(n,y),c.fromBufferAttribute(n,p),a.add(h),l.add(h),c.add(h),n.setXYZ(g,a.x,a.y,a.z),n.setXYZ(y,l.x,l.y,l.z),n.setXYZ(p,c.x,c.y,c.z)}else for(let d=0,f=t.count;d<f;d+=3)i.fromBufferAttribute(t,d+0),r.fromBufferAttribute(t,d+1),o.fromBufferAttribute(t,d+2),h.subVectors(o,r),u.subVectors(i,r),h.cross(u),n.setXYZ(d+0,h.x,h.y,h.z),n.setXYZ(d+1,h.x,h.y,h.z),n.setXYZ(d+2,h.x,h.y,h.z);this.normalizeNormals(),n.needsUpdate=!0}}normalizeNormals(){let e=this.attributes.normal;for(let t=0,n=e.count;t<n;t++)Gt.fromBufferAttribute(e,t),Gt.normalize(),e.setXYZ(t,Gt.x,Gt.y,Gt.z)}toNonIndexed(){function e(a,l){let c=a.array,h=a.itemSize,u=a.normalized,d=new c.constructor(l.length*h),f=0,g=0;for(let y=0,p=l.length;y<p;y++){a.isInterleavedBufferAttribute?f=l[y]*a.data.stride+a.offset:f=l[y]*h;for(let m=0;m<h;m++)d[g++]=c[f++]}return new bt(d,h,u)}if(this.index===null)return Ee("BufferGeometry.toNonIndexed(): BufferGeometry is already non-indexed."),this;let t=new s,n=this.index.array,i=this.attributes;for(let a in i){let l=i[a],c=e(l,n);t.setAttribute(a,c)}let r=this.morphAttributes;for(let a in r){let l=[],c=r[a];for(let h=0,u=c.length;h<u;h++){let d=c[h],f=e(d,n);l.push(f)}t.morphAttributes[a]=l}t.morphTargetsRelative=this.morphTargetsRelative;let o=this.groups;for(let a=0,l=o.length;a<l;a++){let c=o[a];t.addGroup(c.start,c.count,c.materialIndex)}return t}toJSON(){let e={metadata:{version:4.7,type:"BufferGeometry",generator:"BufferGeometry.toJSON"}};if(e.uuid=this.uuid,e.type=this.parameters!==void 0&&this._transformed===!0?"BufferGeometry":this.type,e.name=this.name,Object.keys(this.userData).length>0&&(e.userData=this.userData),this.parameters!==void 0&&this._transformed!==!0){let l=this.parameters;for(let c in l)l[c]!==void 0&&(e[c]=l[c]);return e}e.data={attributes:{}};let t=this.index;t!==null&&(e.data.index={type:t.array.constructor.name,array:Array.prototype.slice.call(t.array)});let n=this.attributes;for(let l in n){let c=n[l];e.data.attributes[l]=c.toJSON(e.data)}let i={},r=!1;for(let l in this.morphAttributes){let c=this.morphAttributes[l],h=[];for(let u=0,d=c.length;u<d;u++){let f=c[u];h.push(f.toJSON(e.data))}h.length>0&&(i[l]=h,r=!0)}r&&(e.data.morphAttributes=i,e.data.morphTargetsRelative=this.morphTargetsRelative);let o=this.groups;o.length>0&&(e.data.groups=JSON.parse(JSON.stringify(o)));let a=this.boundingSphere;return a!==null&&(e.data.boundingSphere=a.toJSON()),e}clone(){return new this.constructor().copy(this)}copy(e){this.index=null,this.attributes={},this.morphAttributes={},this.groups=[],this.boundingBox=null,this.boundingSphere=null;let t={};this.name=e.name;let n=e.index;n!==null&&this.setIndex(n.clone());let i=e.attributes;for(let c in i){let h=i[c];this.setAttribute(c,h.clone(t))}let r=e.morphAttributes;for(let c in r){let h=[],u=r[c];for(let d=0,f=u.length;d<f;d++)h.push(u[d].clone(t));this.morphAttributes[c]=h}this.morphTargetsRelative=e.morphTargetsRelative;let o=e.groups;for(let c=0,h=o.length;c<h;c++){let u=o[c];this.addGroup(u.start,u.count,u.materialIndex)}let a=e.boundingBox;a!==null&&(this.boundingBox=a.clone());let l=e.boundingSphere;return l!==null&&(this.boundingSphere=l.clone()),this.drawRange.start=e.drawRange.start,this.drawRange.count=e.drawRange.count,this.userData=e.userData,this._transformed=e._transformed,this}dispose(){this.dispatchEvent({type:"dispose"})}},ps=class{constructor(e,t){this.isInterleavedBuffer=!0,this.array=e,this.stride=t,this.count=e!==void 0?e.length/t:0,this.usage=xu,this.updateRanges=[],this.version=0,this.uuid=ni()}onUploadCallback(){}set needsUpdate(e){e===!0&&this.version++}setUsage(e){return this.usage=e,this}addUpdateRange(e,t){this.updateRanges.push({start:e,count:t})}clearUpdateRanges(){this.updateRanges.length=0}copy(e){return this.array=new e.array.constructor(e.array),this.count=e.count,this.stride=e.stride,this.usage=e.usage,this}copyAt(e,t,n){e*=this.stride,n*=t.stride;for(let i=0,r=this.stride;i<r;i++)this.array[e+i]=t.array[n+i];return this}set(e,t=0){return this.array.set(e,t),this}clone(e){e.arrayBuffers===void 0&&(e.arrayBuffers={});let t=af(this.array);e.arrayBuffers[t]===void 0&&(e.arrayBuffers[t]=this.array.slice(0).buffer);let n=new this.array.constructor(e.arrayBuffers[t]),i=new this.constructor(n,this.stride);return i.setUsage(this.usage),i}onUpload(e){return this.onUploadCallback=e,this}toJSON(e){e.arrayBuffers===void 0&&(e.arrayBuffers={});let t=af(this.array);e.arrayBuffers[t]===void 0&&(e.arrayBuffers[t]=Array.from(new Uint32Array(this.array.slice(0).buffer)));let n={uuid:this.uuid,buffer:t,type:this.array.constructor.name,stride:this.stride};return n.usage=this.usage,n}};function af(s){return s.buffer._uuid===void 0&&(s.buffer._uuid=ni()),s.byteOffset===0&&s.byteLength===s.buffer.byteLength?s.buffer._uuid:s.buffer._uuid+":"+s.byteOffset+":"+s.byteLength}var on=new S,Gi=class s{constructor(e,t,n,i=!1){this.isInterleavedBufferAttribute=!0,this.name="",this.data=e,this.itemSize=t,this.offset=n,this.normalized=i,this._normalizationScale=e!==void 0?Bl(e.array):void 0}get count(){return this.data.count}get array(){return this.data.array}set needsUpdate(e){this.data.needsUpdate=e}applyMatrix4(e){for(let t=0,n=this.data.count;t<n;t++)on.fromBufferAttribute(this,t),on.applyMatrix4(e),this.setXYZ(t,on.x,on.y,on.z);return this}applyNormalMatrix(e){for(let t=0,n=this.count;t<n;t++)on.fromBufferAttribute(this,t),on.applyNormalMatrix(e),this.setXYZ(t,on.x,on.y,on.z);return this}transformDirection(e){for(let t=0,n=this.count;t<n;t++)on.fromBufferAttribute(this,t),on.transformDirection(e),this.setXYZ(t,on.x,on.y,on.z);return this}getComponent(e,t){let n=this.array[e*this.data.stride+this.offset+t];return this.normalized&&(n=this._denormalize(n)),n}setComponent(e,t,n){return this.normalized&&(n=this._normalize(n)),this.data.array[e*this.data.stride+this.offset+t]=n,this}setX(e,t){return this.normalized&&(t=this._normalize(t)),this.data.array[e*this.data.stride+this.offset]=t,this}setY(e,t){return this.normalized&&(t=this._normalize(t)),this.data.array[e*this.data.stride+this.offset+1]=t,this}setZ(e,t){return this.normalized&&(t=this._normalize(t)),this.data.array[e*this.data.stride+this.offset+2]=t,this}setW(e,t){return this.normalized&&(t=this._normalize(t)),this.data.array[e*this.data.stride+this.offset+3]=t,this}getX(e){let t=this.data.array[e*this.data.stride+this.offset];return this.normalized&&(t=this._denormalize(t)),t}getY(e){let t=this.data.array[e*this.data.stride+this.offset+1];return this.normalized&&(t=this._denormalize(t)),t}getZ(e){let t=this.data.array[e*this.data.stride+this.offset+2];return this.normalized&&(t=this._denormalize(t)),t}getW(e){let t=this.data.array[e*this.data.stride+this.offset+3];return this.normalized&&(t=this._denormalize(t)),t}setXY(e,t,n){return e=e*this.data.stride+this.offset,this.normalized&&(t=this._normalize(t),n=this._normalize(n)),this.data.array[e+0]=t,this.data.array[e+1]=n,this}setXYZ(e,t,n,i){return e=e*this.data.stride+this.offset,this.normalized&&(t=this._normalize(t),n=this._normalize(n),i=this._normalize(i)),this.data.array[e+0]=t,this.data.array[e+1]=n,this.data.array[e+2]=i,this}setXYZW(e,t,n,i,r){return e=e*this.data.stride+this.offset,this.normalized&&(t=this._normalize(t),n=this._normalize(n),i=this._normalize(i),r=this._normalize(r)),this.data.array[e+0]=t,this.data.array[e+1]=n,this.data.array[e+2]=i,this.data.array[e+3]=r,this}clone(e){if(e===void 0){Zr("InterleavedBufferAttribute.clone(): Cloning an interleaved buffer attribute will de-interleave buffer data.");let t=[];for(let n=0;n<this.count;n++){let i=n*this.data.stride+this.offset;for(let r=0;r<this.itemSize;r++)t.push(this.data.array[i+r])}return new bt(new this.array.constructor(t),this.itemSize,this.normalized)}else return e.interleavedBuffers===void 0&&(e.interleavedBuffers={}),e.interleavedBuffers[this.data.uuid]===void 0&&(e.interleavedBuffers[this.data.uuid]=this.data.clone(e)),new s(e.interleavedBuffers[this.data.uuid],this.itemSize,this.offset,this.normalized)}toJSON(e){if(e===void 0){Zr("InterleavedBufferAttribute.toJSON(): Serializing an interleaved buffer attribute will de-interleave buffer data.");let t=[];for(let n=0;n<this.count;n++){let i=n*this.data.stride+this.offset;for(let r=0;r<this.itemSize;r++)t.push(this.data.array[i+r])}return{itemSize:this.itemSize,type:this.array.constructor.name,array:t,normalized:this.normalized}}else return e.interleavedBuffers===void 0&&(e.interleavedBuffers={}),e.interleavedBuffers[this.data.uuid]===void 0&&(e.interleavedBuffers[this.data.uuid]=this.data.toJSON(e)),{isInterleavedBufferAttribute:!0,itemSize:this.itemSize,data:this.data.uuid,offset:this.offset,normalized:this.normalized}}_denormalize(e){let t=this._normalizationScale;return t!==void 0?Math.max(e/t,-1):bu(e,this.data.array)}_normalize(e){let t=this._normalizationScale;return t!==void 0?Math.round(e*t):Mu(e,this.data.array)}},Sh=new S,F0=new S,k0=new Fe,$t=class{constructor(e=new S(1,0,0),t=0){this.isPlane=!0,this.normal=e,this.constant=t}set(e,t){return this.normal.copy(e),this.constant=t,this}setComponents(e,t,n,i){return this.normal.set(e,t,n),this.constant=i,this}setFromNormalAndCoplanarPoint(e,t){return this.normal.copy(e),this.constant=-t.dot(this.normal),this}setFromCoplanarPoints(e,t,n){let i=Sh.subVectors(n,t).cross(F0.subVectors(e,t)).normalize();return this.setFromNormalAndCoplanarPoint(i,e),this}copy(e){return this.normal.copy(e.normal),this.constant=e.constant,this}normalize(){let e=1/this.normal.length();return this.normal.multiplyScalar(e),this.constant*=e,this}negate(){return this.constant*=-1,this.normal.negate(),this}distanceToPoint(e){return this.normal.dot(e)+this.constant}distanceToSphere(e){return this.distanceToPoint(e.center)-e.radius}projectPoint(e,t){return t.copy(e).addScaledVector(this.normal,-this.distanceToPoint(e))}intersectLine(e,t,n=!0){let i=e.delta(Sh),r=this.normal.dot(i);if(r===0)return this.distanceToPoint(e.start)===0?t.copy(e.start):null;let o=-(e.start.dot(this.normal)+this.constant)/r;return n===!0&&(o<0||o>1)?null:t.copy(e.start).addScaledVector(i,o)}intersectsLine(e){let t=this.distanceToPoint(e.start),n=this.distanceToPoint(e.end);return t<0&&n>0||n<0&&t>0}intersectsBox(e){return e.intersectsPlane(this)}intersectsSphere(e){return e.intersectsPlane(this)}coplanarPoint(e){return e.copy(this.normal).multiplyScalar(-this.constant)}applyMatrix4(e,t){let n=t||k0.getNormalMatrix(e),i=this.coplanarPoint(Sh).applyMatrix4(e),r=this.normal.applyMatrix3(n).normalize();return this.constant=-i.dot(r),this}translate(e){return this.constant-=e.dot(this.normal),this}equals(e){return e.normal.equals(this.normal)&&e.constant===this.constant}clone(){return new this.constructor().copy(this)}toJSON(){return{normal:this.normal.toArray(),constant:this.constant}}fromJSON(e){return this.normal.fromArray(e.normal),this.constant=e.constant,this}},B0=0,Yt=class extends Bn{constructor(){super(),this.isMaterial=!0,Object.defineProperty(this,"id",{value:B0++}),this.uuid=ni(),this.name="",this.type="Material",this.blending=vr,this.side=ei,this.vertexColors=!1,this.opacity=1,this.transparent=!1,this.alphaHash=!1,this.blendSrc=Jh,this.blendDst=Qh,this.blendEquation=ws,this.blendSrcAlpha=null,this.blendDstAlpha=null,this.blendEquationAlpha=null,this.blendColor=new ve(0,0,0),this.blendAlpha=0,this.depthFunc=ir,this.depthTest=!0,this.depthWrite=!0,this.stencilWriteMask=255,this.stencilFunc=dp,this.stencilRef=0,this.stencilFuncMask=255,this.stencilFail=Ra,this.stencilZFail=Ra,this.stencilZPass=Ra,this.stencilWrite=!1,this.clippingPlanes=null,this.clipIntersection=!1,this.clipShadows=!1,this.shadowSide=null,this.colorWrite=!0,this.precision=null,this.polygonOffset=!1,this.polygonOffsetFactor=0,this.polygonOffsetUnits=0,this.dithering=!1,this.alphaToCoverage=!1,this.premultipliedAlpha=!1,this.forceSinglePass=!1,this.allowOverride=!0,this.visible=!0,this.toneMapped=!0,this.userData={},this.version=0,this._alphaTest=0}get alphaTest(){return this._alphaTest}set alphaTest(e){this._alphaTest>0!=e>0&&this.version++,this._alphaTest=e}onBeforeRender(){}onBeforeCompile(){}customProgramCacheKey(){return this.onBeforeCompile.toString()}setValues(e){if(e!==void 0)for(let t in e){let n=e[t];if(n===void 0){Ee(`Material: parameter '${t}' has value of undefined.`);continue}let i=this[t];if(i===void 0){Ee(`Material: '${t}' is not a property of THREE.${this.type}.`);continue}i&&i.isColor?i.set(n):i&&i.isVector2&&n&&n.isVector2||i&&i.isEuler&&n&&n.isEuler||i&&i.isVector3&&n&&n.isVector3?i.copy(n):this[t]=n}}toJSON(e){let t=e===void 0||typeof e=="string";t&&(e={textures:{},images:{}});let n={metadata:{version:4.7,type:"Material",generator:"Material.toJSON"}};n.uuid=this.uuid,n.type=this.type,n.blending=this.blending,n.side=this.side,n.shadowSide=this.shadowSide,n.vertexColors=this.vertexColors,n.opacity=this.opacity,n.transparent=this.transparent,n.blendSrc=this.blendSrc,n.blendDst=this.blendDst,n.blendEquation=this.blendEquation,n.blendSrcAlpha=this.blendSrcAlpha,n.blendDstAlpha=this.blendDstAlpha,n.blendEquationAlpha=this.blendEquationAlpha,n.blendColor=this.blendColor.getHex(),n.blendAlpha=this.blendAlpha,n.depthFunc=this.depthFunc,n.depthTest=this.depthTest,n.depthWrite=this.depthWrite,n.colorWrite=this.colorWrite,n.clipIntersection=this.clipIntersection,n.clipShadows=this.clipShadows,n.stencilWriteMask=this.stencilWriteMask,n.stencilFunc=this.stencilFunc,n.stencilRef=this.stencilRef,n.stencilFuncMask=this.stencilFuncMask,n.stencilFail=this.stencilFail,n.stencilZFail=this.stencilZFail,n.stencilZPass=this.stencilZPass,n.stencilWrite=this.stencilWrite,n.polygonOffset=this.polygonOffset,n.polygonOffsetFactor=this.polygonOffsetFactor,n.polygonOffsetUnits=this.polygonOffsetUnits,n.dithering=this.dithering,n.alphaTest=this.alphaTest,n.alphaHash=this.alphaHash,n.alphaToCoverage=this.alphaToCoverage,n.premultipliedAlpha=this.premultipliedAlpha,n.forceSinglePass=this.forceSinglePass,n.allowOverride=this.allowOverride,n.visible=this.visible,n.toneMapped=this.toneMapped,n.name=this.name,this.color&&this.color.isColor&&(n.color=this.color.getHex()),this.roughness!==void 0&&(n.roughness=this.roughness),this.metalness!==void 0&&(n.metalness=this.metalness),this.sheen!==void 0&&(n.sheen=this.sheen),this.sheenColor&&this.sheenColor.isColor&&(n.sheenColor=this.sheenColor.getHex()),this.sheenRoughness!==void 0&&(n.sheenRoughness=this.sheenRoughness),this.emissive&&this.emissive.isColor&&(n.emissive=this.emissive.getHex()),this.emissiveIntensity!==void 0&&(n.emissiveIntensity=this.emissiveIntensity),this.specular&&this.specular.isColor&&(n.specular=this.specular.getHex()),this.specularIntensity!==void 0&&(n.specularIntensity=this.specularIntensity),this.specularColor&&this.specularColor.isColor&&(n.specularColor=this.specularColor.getHex()),this.shininess!==void 0&&(n.shininess=this.shininess),this.clearcoat!==void 0&&(n.clearcoat=this.clearcoat),this.clearcoatRoughness!==void 0&&(n.clearcoatRoughness=this.clearcoatRoughness),this.diffuseRoughness!==void 0&&(n.diffuseRoughness=this.diffuseRoughness),this.diffuseRoughnessMap&&this.diffuseRoughnessMap.isTexture&&(n.diffuseRoughnessMap=this.diffuseRoughnessMap.toJSON(e).uuid),this.clearcoatMap&&this.clearcoatMap.isTexture&&(n.clearcoatMap=this.clearcoatMap.toJSON(e).uuid),this.clearcoatRoughnessMap&&this.clearcoatRoughnessMap.isTexture&&(n.clearcoatRoughnessMap=this.clearcoatRoughnessMap.toJSON(e).uuid),this.clearcoatNormalMap&&this.clearcoatNormalMap.isTexture&&(n.clearcoatNormalMap=this.clearcoatNormalMap.toJSON(e).uuid,n.clearcoatNormalScale=this.clearcoatNormalScale.toArray()),this.sheenColorMap&&this.sheenColorMap.isTexture&&(n.sheenColorMap=this.sheenColorMap.toJSON(e).uuid),this.sheenRoughnessMap&&this.sheenRoughnessMap.isTexture&&(n.sheenRoughnessMap=this.sheenRoughnessMap.toJSON(e).uuid),this.dispersion!==void 0&&(n.dispersion=this.dispersion),this.retroreflectivity!==void 0&&(n.retroreflectivity=this.retroreflectivity),this.iridescence!==void 0&&(n.iridescence=this.iridescence),this.iridescenceIOR!==void 0&&(n.iridescenceIOR=this.iridescenceIOR),this.iridescenceThicknessMinimum!==void 0&&(n.iridescenceThicknessMinimum=this.iridescenceThicknessMinimum),this.iridescenceThicknessMaximum!==void 0&&(n.iridescenceThicknessMaximum=this.iridescenceThicknessMaximum),this.iridescenceMap&&this.iridescenceMap.isTexture&&(n.iridescenceMap=this.iridescenceMap.toJSON(e).uuid),this.iridescenceThicknessMap&&this.iridescenceThicknessMap.isTexture&&(n.iridescenceThicknessMap=this.iridescenceThicknessMap.toJSON(e).uuid),this.anisotropy!==void 0&&(n.anisotropy=this.anisotropy),this.anisotropyRotation!==void 0&&(n.anisotropyRotation=this.anisotropyRotation),this.anisotropyMap&&this.anisotropyMap.isTexture&&(n.anisotropyMap=this.anisotropyMap.toJSON(e).uuid),this.map&&this.map.isTexture&&(n.map=this.map.toJSON(e).uuid),this.matcap&&this.matcap.isTexture&&(n.matcap=this.matcap.toJSON(e).uuid),this.alphaMap&&this.alphaMap.isTexture&&(n.alphaMap=this.alphaMap.toJSON(e).uuid),this.lightMap&&this.lightMap.isTexture&&(n.lightMap=this.lightMap.toJSON(e).uuid,n.lightMapIntensity=this.lightMapIntensity),this.aoMap&&this.aoMap.isTexture&&(n.aoMap=this.aoMap.toJSON(e).uuid,n.aoMapIntensity=this.aoMapIntensity),this.bumpMap&&this.bumpMap.isTexture&&(n.bumpMap=this.bumpMap.toJSON(e).uuid,n.bumpScale=this.bumpScale),this.normalMap&&this.normalMap.isTexture&&(n.normalMap=this.normalMap.toJSON(e).uuid,n.normalMapType=this.normalMapType,n.normalScale=this.normalScale.toArray()),this.displacementMap&&this.displacementMap.isTexture&&(n.displacementMap=this.displacementMap.toJSON(e).uuid,n.displacementScale=this.displacementScale,n.displacementBias=this.displacementBias),this.roughnessMap&&this.roughnessMap.isTexture&&(n.roughnessMap=this.roughnessMap.toJSON(e).uuid),this.metalnessMap&&this.metalnessMap.isTexture&&(n.metalnessMap=this.metalnessMap.toJSON(e).uuid),this.emissiveMap&&this.emissiveMap.isTexture&&(n.emissiveMap=this.emissiveMap.toJSON(e).uuid),this.specularMap&&this.specularMap.isTexture&&(n.specularMap=this.specularMap.toJSON(e).uuid),this.specularIntensityMap&&this.specularIntensityMap.isTexture&&(n.specularIntensityMap=this.specularIntensityMap.toJSON(e).uuid),this.specularColorMap&&this.specularColorMap.isTexture&&(n.specularColorMap=this.specularColorMap.toJSON(e).uuid),this.envMap&&this.envMap.isTexture&&(n.envMap=this.envMap.toJSON(e).uuid,this.combine!==void 0&&(n.combine=this.combine)),this.envMapRotation!==void 0&&(n.envMapRotation=this.envMapRotation.toArray()),this.envMapIntensity!==void 0&&(n.envMapIntensity=this.envMapIntensity),this.reflectivity!==void 0&&(n.reflectivity=this.reflectivity),this.refractionRatio!==void 0&&(n.refractionRatio=this.refractionRatio),this.gradientMap&&this.gradientMap.isTexture&&(n.gradientMap=this.gradientMap.toJSON(e).uuid),this.transmission!==void 0&&(n.transmission=this.transmission),this.transmissionMap&&this.transmissionMap.isTexture&&(n.transmissionMap=this.transmissionMap.toJSON(e).uuid),this.thickness!==void 0&&(n.thickness=this.thickness),this.thicknessMap&&this.thicknessMap.isTexture&&(n.thicknessMap=this.thicknessMap.toJSON(e).uuid),this.attenuationDistance!==void 0&&(n.attenuationDistance=this.attenuationDistance),this.attenuationColor!==void 0&&(n.attenuationColor=this.attenuationColor.getHex()),this.size!==void 0&&(n.size=this.size),this.sizeAttenuation!==void 0&&(n.sizeAttenuation=this.sizeAttenuation),Array.isArray(this.clippingPlanes)&&this.clippingPlanes.length>0&&(n.clippingPlanes=this.clippingPlanes.map(r=>r.toJSON())),this.rotation!==void 0&&(n.rotation=this.rotation),this.depthPacking!==void 0&&(n.depthPacking=this.depthPacking),this.linewidth!==void 0&&(n.linewidth=this.linewidth),this.linecap!==void 0&&(n.linecap=this.linecap),this.linejoin!==void 0&&(n.linejoin=this.linejoin),this.dashSize!==void 0&&(n.dashSize=this.dashSize),this.gapSize!==void 0&&(n.gapSize=this.gapSize),this.scale!==void 0&&(n.scale=this.scale),this.wireframe!==void 0&&(n.wireframe=this.wireframe),this.wireframeLinewidth!==void 0&&(n.wireframeLinewidth=this.wireframeLinewidth),this.wireframeLinecap!==void 0&&(n.wireframeLinecap=this.wireframeLinecap),this.wireframeLinejoin!==void 0&&(n.wireframeLinejoin=this.wireframeLinejoin),this.flatShading!==void 0&&(n.flatShading=this.flatShading),this.fog!==void 0&&(n.fog=this.fog),Object.keys(this.userData).length>0&&(n.userData=this.userData);function i(r){let o=[];for(let a in r){let l=r[a];delete l.metadata,o.push(l)}return o}if(t){let r=i(e.textures),o=i(e.images);r.length>0&&(n.textures=r),o.length>0&&(n.images=o)}return n}fromJSON(e,t){if(e.uuid!==void 0&&(this.uuid=e.uuid),e.name!==void 0&&(this.name=e.name),e.color!==void 0&&this.color!==void 0&&this.color.setHex(e.color),e.roughness!==void 0&&(this.roughness=e.roughness),e.metalness!==void 0&&(this.metalness=e.metalness),e.sheen!==void 0&&(this.sheen=e.sheen),e.sheenColor!==void 0&&(this.sheenColor=new ve().setHex(e.sheenColor)),e.sheenRoughness!==void 0&&(this.sheenRoughness=e.sheenRoughness),e.emissive!==void 0&&this.emissive!==void 0&&this.emissive.setHex(e.emissive),e.specular!==void 0&&this.specular!==void 0&&this.specular.setHex(e.specular),e.specularIntensity!==void 0&&(this.specularIntensity=e.specularIntensity),e.specularColor!==void 0&&this.specularColor!==void 0&&this.specularColor.setHex(e.specularColor),e.shininess!==void 0&&(this.shininess=e.shininess),e.clearcoat!==void 0&&(this.clearcoat=e.clearcoat),e.clearcoatRoughness!==void 0&&(this.clearcoatRoughness=e.clearcoatRoughness),e.diffuseRoughness!==void 0&&(this.diffuseRoughness=e.diffuseRoughness),e.dispersion!==void 0&&(this.dispersion=e.dispersion),e.retroreflectivity!==void 0&&(this.retroreflectivity=e.retroreflectivity),e.iridescence!==void 0&&(this.iridescence=e.iridescence),e.iridescenceIOR!==void 0&&(this.iridescenceIOR=e.iridescenceIOR),e.iridescenceThicknessMinimum!==void 0&&(this.iridescenceThicknessMinimum=e.iridescenceThicknessMinimum),e.iridescenceThicknessMaximum!==void 0&&(this.iridescenceThicknessMaximum=e.iridescenceThicknessMaximum),e.iridescenceThicknessRange!==void 0&&(this.iridescenceThicknessMinimum=e.iridescenceThicknessRange[0],this.iridescenceThicknessMaximum=e.iridescenceThicknessRange[1]),e.transmission!==void 0&&(this.transmission=e.transmission),e.thickness!==void 0&&(this.thickness=e.thickness),e.attenuationDistance!==void 0&&(this.attenuationDistance=e.attenuationDistance),e.attenuationColor!==void 0&&this.attenuationColor!==void 0&&this.attenuationColor.setHex(e.attenuationColor),e.anisotropy!==void 0&&(this.anisotropy=e.anisotropy),e.anisotropyRotation!==void 0&&(this.anisotropyRotation=e.anisotropyRotation),e.fog!==void 0&&(this.fog=e.fog),e.flatShading!==void 0&&(this.flatShading=e.flatShading),e.blending!==void 0&&(this.blending=e.blending),e.combine!==void 0&&(this.combine=e.combine),e.side!==void 0&&(this.side=e.side),e.shadowSide!==void 0&&(this.shadowSide=e.shadowSide),e.opacity!==void 0&&(this.opacity=e.opacity),e.transparent!==void 0&&(this.transparent=e.transparent),e.alphaTest!==void 0&&(this.alphaTest=e.alphaTest),e.alphaHash!==void 0&&(this.alphaHash=e.alphaHash),e.depthFunc!==void 0&&(this.depthFunc=e.depthFunc),e.depthTest!==void 0&&(this.depthTest=e.depthTest),e.depthWrite!==void 0&&(this.depthWrite=e.depthWrite),e.colorWrite!==void 0&&(this.colorWrite=e.colorWrite),e.clippingPlanes!==void 0&&(this.clippingPlanes=e.clippingPlanes.map(n=>new $t().fromJSON(n))),e.clipIntersection!==void 0&&(this.clipIntersection=e.clipIntersection),e.clipShadows!==void 0&&(this.clipShadows=e.clipShadows),e.depthPacking!==void 0&&(this.depthPacking=e.depthPacking),e.blendSrc!==void 0&&(this.blendSrc=e.blendSrc),e.blendDst!==void 0&&(this.blendDst=e.blendDst),e.blendEquation!==void 0&&(this.blendEquation=e.blendEquation),e.blendSrcAlpha!==void 0&&(this.blendSrcAlpha=e.blendSrcAlpha),e.blendDstAlpha!==void 0&&(this.blendDstAlpha=e.blendDstAlpha),e.blendEquationAlpha!==void 0&&(this.blendEquationAlpha=e.blendEquationAlpha),e.blendColor!==void 0&&this.blendColor!==void 0&&this.blendColor.setHex(e.blendColor),e.blendAlpha!==void 0&&(this.blendAlpha=e.blendAlpha),e.stencilWriteMask!==void 0&&(this.stencilWriteMask=e.stencilWriteMask),e.stencilFunc!==void 0&&(this.stencilFunc=e.stencilFunc),e.stencilRef!==void 0&&(this.stencilRef=e.stencilRef),e.stencilFuncMask!==void 0&&(this.stencilFuncMask=e.stencilFuncMask),e.stencilFail!==void 0&&(this.stencilFail=e.stencilFail),e.stencilZFail!==void 0&&(this.stencilZFail=e.stencilZFail),e.stencilZPass!==void 0&&(this.stencilZPass=e.stencilZPass),e.stencilWrite!==void 0&&(this.stencilWrite=e.stencilWrite),e.wireframe!==void 0&&(this.wireframe=e.wireframe),e.wireframeLinewidth!==void 0&&(this.wireframeLinewidth=e.wireframeLinewidth),e.wireframeLinecap!==void 0&&(this.wireframeLinecap=e.wireframeLinecap),e.wireframeLinejoin!==void 0&&(this.wireframeLinejoin=e.wireframeLinejoin),e.rotation!==void 0&&(this.rotation=e.rotation),e.linewidth!==void 0&&(this.linewidth=e.linewidth),e.linecap!==void 0&&(this.linecap=e.linecap),e.linejoin!==void 0&&(this.linejoin=e.linejoin),e.dashSize!==void 0&&(this.dashSize=e.dashSize),e.gapSize!==void 0&&(this.gapSize=e.gapSize),e.scale!==void 0&&(this.scale=e.scale),e.polygonOffset!==void 0&&(this.polygonOffset=e.polygonOffset),e.polygonOffsetFactor!==void 0&&(this.polygonOffsetFactor=e.polygonOffsetFactor),e.polygonOffsetUnits!==void 0&&(this.polygonOffsetUnits=e.polygonOffsetUnits),e.dithering!==void 0&&(this.dithering=e.dithering),e.alphaToCoverage!==void 0&&(this.alphaToCoverage=e.alphaToCoverage),e.premultipliedAlpha!==void 0&&(this.premultipliedAlpha=e.premultipliedAlpha),e.forceSinglePass!==void 0&&(this.forceSinglePass=e.forceSinglePass),e.allowOverride!==void 0&&(this.allowOverride=e.allowOverride),e.visible!==void 0&&(this.visible=e.visible),e.toneMapped!==void 0&&(this.toneMapped=e.toneMapped),e.userData!==void 0&&(this.userData=e.userData),e.vertexColors!==void 0&&(typeof e.vertexColors=="number"?this.vertexColors=e.vertexColors>0:this.vertexColors=e.vertexColors),e.size!==void 0&&(this.size=e.size),e.sizeAttenuation!==void 0&&(this.sizeAttenuation=e.sizeAttenuation),e.map!==void 0&&(this.map=t[e.map]||null),e.matcap!==void 0&&(this.matcap=t[e.matcap]||null),e.alphaMap!==void 0&&(this.alphaMap=t[e.alphaMap]||null),e.bumpMap!==void 0&&(this.bumpMap=t[e.bumpMap]||null),e.bumpScale!==void 0&&(this.bumpScale=e.bumpScale),e.normalMap!==void 0&&(this.normalMap=t[e.normalMap]||null),e.normalMapType!==void 0&&(this.normalMapType=e.normalMapType),e.normalScale!==void 0){let n=e.normalScale;Array.isArray(n)===!1&&(n=[n,n]),this.normalScale=new ye().fromArray(n)}return e.displacementMap!==void 0&&(this.displacementMap=t[e.displacementMap]||null),e.displacementScale!==void 0&&(this.displacementScale=e.displacementScale),e.displacementBias!==void 0&&(this.displacementBias=e.displacementBias),e.roughnessMap!==void 0&&(this.roughnessMap=t[e.roughnessMap]||null),e.metalnessMap!==void 0&&(this.metalnessMap=t[e.metalnessMap]||null),e.emissiveMap!==void 0&&(this.emissiveMap=t[e.emissiveMap]||null),e.emissiveIntensity!==void 0&&(this.emissiveIntensity=e.emissiveIntensity),e.specularMap!==void 0&&(this.specularMap=t[e.specularMap]||null),e.specularIntensityMap!==void 0&&(this.specularIntensityMap=t[e.specularIntensityMap]||null),e.specularColorMap!==void 0&&(this.specularColorMap=t[e.specularColorMap]||null),e.envMap!==void 0&&(this.envMap=t[e.envMap]||null),e.envMapRotation!==void 0&&this.envMapRotation.fromArray(e.envMapRotation),e.envMapIntensity!==void 0&&(this.envMapIntensity=e.envMapIntensity),e.reflectivity!==void 0&&(this.reflectivity=e.reflectivity),e.refractionRatio!==void 0&&(this.refractionRatio=e.refractionRatio),e.lightMap!==void 0&&(this.lightMap=t[e.lightMap]||null),e.lightMapIntensity!==void 0&&(this.lightMapIntensity=e.lightMapIntensity),e.aoMap!==void 0&&(this.aoMap=t[e.aoMap]||null),e.aoMapIntensity!==void 0&&(this.aoMapIntensity=e.aoMapIntensity),e.gradientMap!==void 0&&(this.gradientMap=t[e.gradientMap]||null),e.clearcoatMap!==void 0&&(this.clearcoatMap=t[e.clearcoatMap]||null),e.clearcoatRoughnessMap!==void 0&&(this.clearcoatRoughnessMap=t[e.clearcoatRoughnessMap]||null),e.clearcoatNormalMap!==void 0&&(this.clearcoatNormalMap=t[e.clearcoatNormalMap]||null),e.clearcoatNormalScale!==void 0&&(this.clearcoatNormalScale=new ye().fromArray(e.clearcoatNormalScale)),e.diffuseRoughnessMap!==void 0&&(this.diffuseRoughnessMap=t[e.diffuseRoughnessMap]||null),e.iridescenceMap!==void 0&&(this.iridescenceMap=t[e.iridescenceMap]||null),e.iridescenceThicknessMap!==void 0&&(this.iridescenceThicknessMap=t[e.iridescenceThicknessMap]||null),e.transmissionMap!==void 0&&(this.transmissionMap=t[e.transmissionMap]||null),e.thicknessMap!==void 0&&(this.thicknessMap=t[e.thicknessMap]||null),e.anisotropyMap!==void 0&&(this.anisotropyMap=t[e.anisotropyMap]||null),e.sheenColorMap!==void 0&&(this.sheenColorMap=t[e.sheenColorMap]||null),e.sheenRoughnessMap!==void 0&&(this.sheenRoughnessMap=t[e.sheenRoughnessMap]||null),this}clone(){return new this.constructor().copy(this)}copy(e){this.name=e.name,this.blending=e.blending,this.side=e.side,this.vertexColors=e.vertexColors,this.opacity=e.opacity,this.transparent=e.transparent,this.blendSrc=e.blendSrc,this.blendDst=e.blendDst,this.blendEquation=e.blendEquation,this.blendSrcAlpha=e.blendSrcAlpha,this.blendDstAlpha=e.blendDstAlpha,this.blendEquationAlpha=e.blendEquationAlpha,this.blendColor.copy(e.blendColor),this.blendAlpha=e.blendAlpha,this.depthFunc=e.depthFunc,this.depthTest=e.depthTest,this.depthWrite=e.depthWrite,this.stencilWriteMask=e.stencilWriteMask,this.stencilFunc=e.stencilFunc,this.stencilRef=e.stencilRef,this.stencilFuncMask=e.stencilFuncMask,this.stencilFail=e.stencilFail,this.stencilZFail=e.stencilZFail,this.stencilZPass=e.stencilZPass,this.stencilWrite=e.stencilWrite;let t=e.clippingPlanes,n=null;if(t!==null){let i=t.length;n=new Array(i);for(let r=0;r!==i;++r)n[r]=t[r].clone()}return this.clippingPlanes=n,this.clipIntersection=e.clipIntersection,this.clipShadows=e.clipShadows,this.shadowSide=e.shadowSide,this.colorWrite=e.colorWrite,this.precision=e.precision,this.polygonOffset=e.polygonOffset,this.polygonOffsetFactor=e.polygonOffsetFactor,this.polygonOffsetUnits=e.polygonOffsetUnits,this.dithering=e.dithering,this.alphaTest=e.alphaTest,this.alphaHash=e.alphaHash,this.alphaToCoverage=e.alphaToCoverage,this.premultipliedAlpha=e.premultipliedAlpha,this.forceSinglePass=e.forceSinglePass,this.allowOverride=e.allowOverride,this.visible=e.visible,this.toneMapped=e.toneMapped,this.userData=JSON.parse(JSON.stringify(e.userData)),this}dispose(){this.dispatchEvent({type:"dispose"})}set needsUpdate(e){e===!0&&this.version++}},hr=class extends Yt{constructor(e){super(),this.isSpriteMaterial=!0,this.type="SpriteMaterial",this.color=new ve(16777215),this.map=null,this.alphaMap=null,this.rotation=0,this.sizeAttenuation=!0,this.transparent=!0,this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.alphaMap=e.alphaMap,this.rotation=e.rotation,this.sizeAttenuation=e.sizeAttenuation,this.fog=e.fog,this}},qs,Hr=new S,$s=new S,Ys=new S,Ks=new ye,Gr=new ye,wp=new _e,na=new S,Vr=new S,ia=new S,lf=new ye,Th=new ye,cf=new ye,to=class extends it{constructor(e=new hr){if(super(),this.isSprite=!0,this.type="Sprite",qs===void 0){qs=new Ye;let t=new Float32Array([-.5,-.5,0,0,0,.5,-.5,0,1,0,.5,.5,0,1,1,-.5,.5,0,0,1]),n=new ps(t,5);qs.setIndex([0,1,2,0,2,3]),qs.setAttribute("position",new Gi(n,3,0,!1)),qs.setAttribute("uv",new Gi(n,2,3,!1))}this.geometry=qs,this.material=e,this.center=new ye(.5,.5),this.count=1}intersectsFrustum(e){return e.intersectsSprite(this)}raycast(e,t){e.camera===null&&Oe('Sprite: "Raycaster.camera" needs to be set in order to raycast against sprites.'),$s.setFromMatrixScale(this.matrixWorld),wp.copy(e.camera.matrixWorld),this.modelViewMatrix.multiplyMatrices(e.camera.matrixWorldInverse,this.matrixWorld),Ys.setFromMatrixPosition(this.modelViewMatrix),e.camera.isPerspectiveCamera&&this.material.sizeAttenuation===!1&&$s.multiplyScalar(-Ys.z);let n=this.material.rotation,i,r;n!==0&&(r=Math.cos(n),i=Math.sin(n));let o=this.center;sa(na.set(-.5,-.5,0),Ys,o,$s,i,r),sa(Vr.set(.5,-.5,0),Ys,o,$s,i,r),sa(ia.set(.5,.5,0),Ys,o,$s,i,r),lf.set(0,0),Th.set(1,0),cf.set(1,1);let a=e.ray.intersectTriangle(na,Vr,ia,!1,Hr);if(a===null&&(sa(Vr.set(-.5,.5,0),Ys,o,$s,i,r),Th.set(0,1),a=e.ray.intersectTriangle(na,ia,Vr,!1,Hr),a===null))return;let l=e.ray.origin.distanceTo(Hr);l<e.near||l>e.far||t.push({distance:l,point:Hr.clone(),uv:Yn.getInterpolation(Hr,na,Vr,ia,lf,Th,cf,new ye),face:null,object:this})}copy(e,t){return super.copy(e,t),e.center!==void 0&&this.center.copy(e.center),this.material=e.material,this}toJSON(e){let t=super.toJSON(e);return t.object.center=this.center.toArray(),t}};function sa(s,e,t,n,i,r){Ks.subVectors(s,t).addScalar(.5).multiply(n),i!==void 0?(Gr.x=r*Ks.x-i*Ks.y,Gr.y=i*Ks.x+r*Ks.y):Gr.copy(Ks),s.copy(e),s.x+=Gr.x,s.y+=Gr.y,s.applyMatrix4(wp)}var pi=new S,Ah=new S,ra=new S,oa=new S,Zn=class{constructor(e=new S,t=new S(0,0,-1)){this.origin=e,this.direction=t}set(e,t){return this.origin.copy(e),this.direction.copy(t),this}copy(e){return this.origin.copy(e.origin),this.direction.copy(e.direction),this}at(e,t){return t.copy(this.origin).addScaledVector(this.direction,e)}lookAt(e){return this.direction.copy(e).sub(this.origin).normalize(),this}recast(e){return this.origin.copy(this.at(e,pi)),this}closestPointToPoint(e,t){t.subVectors(e,this.origin);let n=t.dot(this.direction);return n<0?t.copy(this.origin):t.copy(this.origin).addScaledVector(this.direction,n)}distanceToPoint(e){return Math.sqrt(this.distanceSqToPoint(e))}distanceSqToPoint(e){let t=pi.subVectors(e,this.origin).dot(this.direction);return t<0?this.origin.distanceToSquared(e):(pi.copy(this.origin).addScaledVector(this.direction,t),pi.distanceToSquared(e))}distanceSqToSegment(e,t,n,i){Ah.copy(e).add(t).multiplyScalar(.5),ra.copy(t).sub(e).normalize(),oa.copy(this.origin).sub(Ah);let r=e.distanceTo(t)*.5,o=-this.direction.dot(ra),a=oa.dot(this.direction),l=-oa.dot(ra),c=oa.lengthSq(),h=Math.abs(1-o*o),u,d,f,g;if(h>0)if(u=o*l-a,d=o*a-l,g=r*h,u>=0)if(d>=-g)if(d<=g){let y=1/h;u*=y,d*=y,f=u*(u+o*d+2*a)+d*(o*u+d+2*l)+c}else d=r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*l)+c;else d=-r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*l)+c;else d<=-g?(u=Math.max(0,-(-o*r+a)),d=u>0?-r:Math.min(Math.max(-r,-l),r),f=-u*u+d*(d+2*l)+c):d<=g?(u=0,d=Math.min(Math.max(-r,-l),r),f=d*(d+2*l)+c):(u=Math.max(0,-(o*r+a)),d=u>0?r:Math.min(Math.max(-r,-l),r),f=-u*u+d*(d+2*l)+c);else d=o>0?-r:r,u=Math.max(0,-(o*d+a)),f=-u*u+d*(d+2*l)+c;return n&&n.copy(this.origin).addScaledVector(this.direction,u),i&&i.copy(Ah).addScaledVector(ra,d),f}intersectSphere(e,t){if(e.radius<0)return null;pi.subVectors(e.center,this.origin);let n=pi.dot(this.direction),i=pi.dot(pi)-n*n,r=e.radius*e.radius;if(i>r)return null;let o=Math.sqrt(r-i),a=n-o,l=n+o;return l<0?null:a<0?this.at(l,t):this.at(a,t)}intersectsSphere(e){return e.radius<0?!1:this.distanceSqToPoint(e.center)<=e.radius*e.radius}distanceToPlane(e){let t=e.normal.dot(this.direction);if(t===0)return e.distanceToPoint(this.origin)===0?0:null;let n=-(this.origin.dot(e.normal)+e.constant)/t;return n>=0?n:null}intersectPlane(e,t){let n=this.distanceToPlane(e);return n===null?null:this.at(n,t)}intersectsPlane(e){let t=e.distanceToPoint(this.origin);return t===0||e.normal.dot(this.direction)*t<0}intersectBox(e,t){let n,i,r,o,a,l,c=1/this.direction.x,h=1/this.direction.y,u=1/this.direction.z,d=this.origin;return c>=0?(n=(e.min.x-d.x)*c,i=(e.max.x-d.x)*c):(n=(e.max.x-d.x)*c,i=(e.min.x-d.x)*c),h>=0?(r=(e.min.y-d.y)*h,o=(e.max.y-d.y)*h):(r=(e.max.y-d.y)*h,o=(e.min.y-d.y)*h),n>o||r>i||((r>n||isNaN(n))&&(n=r),(o<i||isNaN(i))&&(i=o),u>=0?(a=(e.min.z-d.z)*u,l=(e.max.z-d.z)*u):(a=(e.max.z-d.z)*u,l=(e.min.z-d.z)*u),n>l||a>i)||((a>n||n!==n)&&(n=a),(l<i||i!==i)&&(i=l),i<0)?null:this.at(n>=0?n:i,t)}intersectsBox(e){return this.intersectBox(e,pi)!==null}intersectTriangle(e,t,n,i,r){let o=this.origin,a=this.direction,l=a.x,c=a.y,h=a.z,u=e.x-o.x,d=e.y-o.y,f=e.z-o.z,g=t.x-o.x,y=t.y-o.y,p=t.z-o.z,m=n.x-o.x,b=n.y-o.y,E=n.z-o.z,M=Math.abs(l),R=Math.abs(c),T=Math.abs(h),x,w,O,I,N,k,V,P,G,q,H,te;if(M>=R&&M>=T?(O=l,k=u,G=g,te=m,l>=0?(x=c,w=h,I=d,N=f,V=y,P=p,q=b,H=E):(x=h,w=c,I=f,N=d,V=p,P=y,q=E,H=b)):R>=T?(O=c,k=d,G=y,te=b,c>=0?(x=h,w=l,I=f,N=u,V=p,P=g,q=E,H=m):(x=l,w=h,I=u,N=f,V=g,P=p,q=m,H=E)):(O=h,k=f,G=p,te=E,h>=0?(x=l,w=c,I=u,N=d,V=g,P=y,q=m,H=b):(x=c,w=l,I=d,N=u,V=y,P=g,q=b,H=m)),O===0)return null;let X=x/O,J=w/O,Q=1/O,Te=I-X*k,Be=N-J*k,K=V-X*G,me=P-J*G,Me=q-X*te,Ie=H-J*te,ge=Me*me-Ie*K,He=Te*Ie-Be*Me,Rt=K*Be-me*Te;if(i){if(ge<0||He<0||Rt<0)return null}else if((ge<0||He<0||Rt<0)&&(ge>0||He>0||Rt>0))return null;let Ne=ge+He+Rt;if(Ne===0)return null;let st=Q*(ge*k+He*G+Rt*te);return(Ne>0?st<0:st>0)?null:this.at(st/Ne,r)}applyMatrix4(e){return this.origin.applyMatrix4(e),this.direction.transformDirection(e),this}equals(e){return e.origin.equals(this.origin)&&e.direction.equals(this.direction)}clone(){return new this.constructor().copy(this)}},lt=class extends Yt{constructor(e){super(),this.isMeshBasicMaterial=!0,this.type="MeshBasicMaterial",this.color=new ve(16777215),this.map=null,this.lightMap=null,this.lightMapIntensity=1,this.aoMap=null,this.aoMapIntensity=1,this.specularMap=null,this.alphaMap=null,this.envMap=null,this.envMapRotation=new jn,this.combine=Ja,this.reflectivity=1,this.refractionRatio=.98,this.wireframe=!1,this.wireframeLinewidth=1,this.wireframeLinecap="round",this.wireframeLinejoin="round",this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.lightMap=e.lightMap,this.lightMapIntensity=e.lightMapIntensity,this.aoMap=e.aoMap,this.aoMapIntensity=e.aoMapIntensity,this.specularMap=e.specularMap,this.alphaMap=e.alphaMap,this.envMap=e.envMap,this.envMapRotation.copy(e.envMapRotation),this.combine=e.combine,this.reflectivity=e.reflectivity,this.refractionRatio=e.refractionRatio,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.wireframeLinecap=e.wireframeLinecap,this.wireframeLinejoin=e.wireframeLinejoin,this.fog=e.fog,this}},hf=new _e,ls=new Zn,aa=new un,uf=new S,la=new S,ca=new S,ha=new S,Eh=new S,ua=new S,df=new S,da=new S,ue=class extends it{constructor(e=new Ye,t=new lt){super(),this.isMesh=!0,this.type="Mesh",this.geometry=e,this.material=t,this.morphTargetDictionary=void 0,this.morphTargetInfluences=void 0,this.count=1,this.updateMorphTargets()}copy(e,t){return super.copy(e,t),e.morphTargetInfluences!==void 0?this.morphTargetInfluences=e.morphTargetInfluences.slice():this.morphTargetInfluences=void 0,e.morphTargetDictionary!==void 0?this.morphTargetDictionary=Object.assign({},e.morphTargetDictionary):this.morphTargetDictionary=void 0,this.material=Array.isArray(e.material)?e.material.slice():e.material,this.geometry=e.geometry,this}updateMorphTargets(){let t=this.geometry.morphAttributes,n=Object.keys(t);if(n.length>0){let i=t[n[0]];if(i!==void 0){this.morphTargetInfluences=[],this.morphTargetDictionary={};for(let r=0,o=i.length;r<o;r++){let a=i[r].name||String(r);this.morphTargetInfluences.push(0),this.morphTargetDictionary[a]=r}}}}getVertexPosition(e,t){let n=this.geometry,i=n.attributes.position,r=n.morphAttributes.position,o=n.morphTargetsRelative;t.fromBufferAttribute(i,e);let a=this.morphTargetInfluences;if(r&&a){ua.set(0,0,0);for(let l=0,c=r.length;l<c;l++){let h=a[l],u=r[l];h!==0&&(Eh.fromBufferAttribute(u,e),o?ua.addScaledVector(Eh,h):ua.addScaledVector(Eh.sub(t),h))}t.add(ua)}return t}intersectsFrustum(e){return e.intersectsObject(this)}raycast(e,t){let n=this.geometry,i=this.material,r=this.matrixWorld;i!==void 0&&(n.boundingSphere===null&&n.computeBoundingSphere(),aa.copy(n.boundingSphere),aa.applyMatrix4(r),ls.copy(e.ray).recast(e.near),!(aa.containsPoint(ls.origin)===!1&&(ls.intersectSphere(aa,uf)===null||ls.origin.distanceToSquared(uf)>(e.far-e.near)**2))&&(hf.copy(r).invert(),ls.copy(e.ray).applyMatrix4(hf),!(n.boundingBox!==null&&ls.intersectsBox(n.boundingBox)===!1)&&this._computeIntersections(e,t,ls)))}_computeIntersections(e,t,n){let i,r=this.geometry,o=this.material,a=r.index,l=r.attributes.position,c=r.attributes.uv,h=r.attributes.uv1,u=r.attributes.normal,d=r.groups,f=r.drawRange;if(a!==null)if(Array.isArray(o))for(let g=0,y=d.length;g<y;g++){let p=d[g],m=o[p.materialIndex],b=Math.max(p.start,f.start),E=Math.min(a.count,Math.min(p.start+p.count,f.start+f.count));for(let M=b,R=E;M<R;M+=3){let T=a.getX(M),x=a.getX(M+1),w=a.getX(M+2);i=fa(this,m,e,n,c,h,u,T,x,w),i&&(i.faceIndex=Math.floor(M/3),i.face.materialIndex=p.materialIndex,t.push(i))}}else{let g=Math.max(0,f.start),y=Math.min(a.count,f.start+f.count);for(let p=g,m=y;p<m;p+=3){let b=a.getX(p),E=a.getX(p+1),M=a.getX(p+2);i=fa(this,o,e,n,c,h,u,b,E,M),i&&(i.faceIndex=Math.floor(p/3),t.push(i))}}else if(l!==void 0)if(Array.isArray(o))for(let g=0,y=d.length;g<y;g++){let p=d[g],m=o[p.materialIndex],b=Math.max(p.start,f.start),E=Math.min(l.count,Math.min(p.start+p.count,f.start+f.count));for(let M=b,R=E;M<R;M+=3){let T=M,x=M+1,w=M+2;i=fa(this,m,e,n,c,h,u,T,x,w),i&&(i.faceIndex=Math.floor(M/3),i.face.materialIndex=p.materialIndex,t.push(i))}}else{let g=Math.max(0,f.start),y=Math.min(l.count,f.start+f.count);for(let p=g,m=y;p<m;p+=3){let b=p,E=p+1,M=p+2;i=fa(this,o,e,n,c,h,u,b,E,M),i&&(i.faceIndex=Math.floor(p/3),t.push(i))}}}};function z0(s,e,t,n,i,r,o,a){let l;if(e.side===Kt?l=n.intersectTriangle(o,r,i,!0,a):l=n.intersectTriangle(i,r,o,e.side===ei,a),l===null)return null;da.copy(a),da.applyMatrix4(s.matrixWorld);let c=t.ray.origin.distanceTo(da);return c<t.near||c>t.far?null:{distance:c,point:da.clone(),object:s}}function fa(s,e,t,n,i,r,o,a,l,c){s.getVertexPosition(a,la),s.getVertexPosition(l,ca),s.getVertexPosition(c,ha);let h=z0(s,e,t,n,la,ca,ha,df);if(h){let u=new S;Yn.getBarycoord(df,la,ca,ha,u),i&&(h.uv=Yn.getInterpolatedAttribute(i,a,l,c,u,new ye)),r&&(h.uv1=Yn.getInterpolatedAttribute(r,a,l,c,u,new ye)),o&&(h.normal=Yn.getInterpolatedAttribute(o,a,l,c,u,new S),h.normal.dot(n.direction)>0&&h.normal.multiplyScalar(-1));let d={a,b:l,c,normal:new S,materialIndex:0};Yn.getNormal(la,ca,ha,d.normal),h.face=d,h.barycoord=u}return h}var Wr=new at,ff=new at,pf=new at,H0=new at,mf=new _e,pa=new S,Rh=new un,gf=new _e,Ch=new Zn,no=class extends ue{constructor(e,t){super(e,t),this.isSkinnedMesh=!0,this.type="SkinnedMesh",this.bindMode=Oh,this.bindMatrix=new _e,this.bindMatrixInverse=new _e,this.boundingBox=null,this.boundingSphere=null}computeBoundingBox(){let e=this.geometry;this.boundingBox===null&&(this.boundingBox=new vt),this.boundingBox.makeEmpty();let t=e.getAttribute("position");for(let n=0;n<t.count;n++)this.getVertexPosition(n,pa),this.boundingBox.expandByPoint(pa)}computeBoundingSphere(){let e=this.geometry;this.boundingSphere===null&&(this.boundingSphere=new un),this.boundingSphere.makeEmpty();let t=e.getAttribute("position");for(let n=0;n<t.count;n++)this.getVertexPosition(n,pa),this.boundingSphere.expandByPoint(pa)}copy(e,t){return super.copy(e,t),this.bindMode=e.bindMode,this.bindMatrix.copy(e.bindMatrix),this.bindMatrixInverse.copy(e.bindMatrixInverse),this.skeleton=e.skeleton,this.boundingBox=e.boundingBox!==null?e.boundingBox.clone():null,this.boundingSphere=e.boundingSphere!==null?e.boundingSphere.clone():null,this}raycast(e,t){let n=this.material,i=this.matrixWorld;n!==void 0&&(this.boundingSphere===null&&this.computeBoundingSphere(),Rh.copy(this.boundingSphere),Rh.applyMatrix4(i),e.ray.intersectsSphere(Rh)!==!1&&(gf.copy(i).invert(),Ch.copy(e.ray).applyMatrix4(gf),!(this.boundingBox!==null&&Ch.intersectsBox(this.boundingBox)===!1)&&this._computeIntersections(e,t,Ch)))}getVertexPosition(e,t){return super.getVertexPosition(e,t),this.applyBoneTransform(e,t),t}bind(e,t){this.skeleton=e,t===void 0&&(this.updateMatrixWorld(!0),this.skeleton.calculateInverses(),t=this.matrixWorld),this.bindMatrix.copy(t),this.bindMatrixInverse.copy(t).invert()}pose(){this.skeleton.pose()}normalizeSkinWeights(){let e=new at,t=this.geometry.attributes.skinWeight;for(let n=0,i=t.count;n<i;n++){e.fromBufferAttribute(t,n);let r=1/e.manhattanLength();r!==1/0?e.multiplyScalar(r):e.set(1,0,0,0),t.setXYZW(n,e.x,e.y,e.z,e.w)}}updateMatrixWorld(e){super.updateMatrixWorld(e),this.bindMode===Oh?this.bindMatrixInverse.copy(this.matrixWorld).invert():this.bindMode===lp?this.bindMatrixInverse.copy(this.bindMatrix).invert():Ee("SkinnedMesh: Unrecognized bindMode: "+this.bindMode)}applyBoneTransform(e,t){let n=this.skeleton,i=this.geometry;ff.fromBufferAttribute(i.attributes.skinIndex,e),pf.fromBufferAttribute(i.attributes.skinWeight,e),t.isVector4?(Wr.copy(t),t.set(0,0,0,0)):(Wr.set(t.x,t.y,t.z,1),t.set(0,0,0)),Wr.applyMatrix4(this.bindMatrix);for(let r=0;r<4;r++){let o=pf.getComponent(r);if(o!==0){let a=ff.getComponent(r);mf.multiplyMatrices(n.bones[a].matrixWorld,n.boneInverses[a]),t.addScaledVector(H0.copy(Wr).applyMatrix4(mf),o)}}return t.isVector4&&(t.w=Wr.w),t.applyMatrix4(this.bindMatrixInverse)}},ur=class extends it{constructor(){super(),this.isBone=!0,this.type="Bone"}},dr=class extends Nt{constructor(e=null,t=1,n=1,i,r,o,a,l,c=gt,h=gt,u,d){super(null,o,a,l,c,h,i,r,u,d),this.isDataTexture=!0,this.image={data:e,width:t,height:n},this.generateMipmaps=!1,this.flipY=!1,this.unpackAlignment=1}},xf=new _e,G0=new _e,io=class s{constructor(e=[],t=[]){this.uuid=ni(),this.bones=e.slice(0),this.boneInverses=t,this.boneMatrices=null,this.previousBoneMatrices=null,this.boneTexture=null,this.previousBoneTexture=null,this.init()}init(){let e=this.bones,t=this.boneInverses;if(this.boneMatrices=new Float32Array(e.length*16),t.length===0)this.calculateInverses();else if(e.length!==t.length){Ee("Skeleton: Number of inverse bone matrices does not match amount of bones."),this.boneInverses=[];for(let n=0,i=this.bones.length;n<i;n++)this.boneInverses.push(new _e)}}calculateInverses(){this.boneInverses.length=0;for(let e=0,t=this.bones.length;e<t;e++){let n=new _e;this.bones[e]&&n.copy(this.bones[e].matrixWorld).invert(),this.boneInverses.push(n)}}pose(){for(let e=0,t=this.bones.length;e<t;e++){let n=this.bones[e];n&&n.matrixWorld.copy(this.boneInverses[e]).invert()}for(let e=0,t=this.bones.length;e<t;e++){let n=this.bones[e];n&&(n.parent&&n.parent.isBone?(n.matrix.copy(n.parent.matrixWorld).invert(),n.matrix.multiply(n.matrixWorld)):n.matrix.copy(n.matrixWorld),n.matrix.decompose(n.position,n.quaternion,n.scale))}}update(){let e=this.bones,t=this.boneInverses,n=this.boneMatrices,i=this.boneTexture;for(let r=0,o=e.length;r<o;r++){let a=e[r]?e[r].matrixWorld:G0;xf.multiplyMatrices(a,t[r]),xf.toArray(n,r*16)}i!==null&&(i.needsUpdate=!0)}clone(){return new s(this.bones,this.boneInverses)}computeBoneTexture(){let e=Math.sqrt(this.bones.length*4);e=Math.ceil(e/4)*4,e=Math.max(e,4);let t=new Float32Array(e*e*4);t.set(this.boneMatrices);let n=new dr(t,e,e,Dn,_n);return n.needsUpdate=!0,this.boneMatrices=t,this.boneTexture=n,this}getBoneByName(e){for(let t=0,n=this.bones.length;t<n;t++){let i=this.bones[t];if(i.name===e)return i}}dispose(){this.boneTexture!==null&&(this.boneTexture.dispose(),this.boneTexture=null),this.previousBoneTexture!==null&&(this.previousBoneTexture.dispose(),this.previousBoneTexture=null)}fromJSON(e,t){this.uuid=e.uuid;for(let n=0,i=e.bones.length;n<i;n++){let r=e.bones[n],o=t[r];o===void 0&&(Ee("Skeleton: No bone found with UUID:",r),o=new ur),this.bones.push(o),this.boneInverses.push(new _e().fromArray(e.boneInverses[n]))}return this.init(),this}toJSON(){let e={metadata:{version:4.7,type:"Skeleton",generator:"Skeleton.toJSON"},bones:[],boneInverses:[]};e.uuid=this.uuid;let t=this.bones,n=this.boneInverses;for(let i=0,r=t.length;i<r;i++){let o=t[i];e.bones.push(o.uuid);let a=n[i];e.boneInverses.push(a.toArray())}return e}},vi=class extends bt{constructor(e,t,n,i=1){super(e,t,n),this.isInstancedBufferAttribute=!0,this.meshPerAttribute=i}copy(e){return super.copy(e),this.meshPerAttribute=e.meshPerAttribute,this}toJSON(){let e=super.toJSON();return e.meshPerAttribute=this.meshPerAttribute,e.isInstancedBufferAttribute=!0,e}},js=new _e,yf=new _e,ma=[],vf=new vt,V0=new _e,Xr=new ue,qr=new un,_i=class extends ue{constructor(e,t,n){super(e,t),this.isInstancedMesh=!0,this.instanceMatrix=new vi(new Float32Array(n*16),16),this.instanceColor=null,this.morphTexture=null,this.count=n,this.boundingBox=null,this.boundingSphere=null;for(let i=0;i<n;i++)this.setMatrixAt(i,V0)}computeBoundingBox(){let e=this.geometry,t=this.count;this.boundingBox===null&&(this.boundingBox=new vt),e.boundingBox===null&&e.computeBoundingBox(),this.boundingBox.makeEmpty();for(let n=0;n<t;n++)this.getMatrixAt(n,js),vf.copy(e.boundingBox).applyMatrix4(js),this.boundingBox.union(vf)}computeBoundingSphere(){let e=this.geometry,t=this.count;this.boundingSphere===null&&(this.boundingSphere=new un),e.boundingSphere===null&&e.computeBoundingSphere(),this.boundingSphere.makeEmpty();for(let n=0;n<t;n++)this.getMatrixAt(n,js),qr.copy(e.boundingSphere).applyMatrix4(js),this.boundingSphere.union(qr)}copy(e,t){return super.copy(e,t),this.instanceMatrix.copy(e.instanceMatrix),this.morphTexture=e.morphTexture!==null?e.morphTexture.clone():null,this.instanceColor=e.instanceColor!==null?e.instanceColor.clone():null,this.count=e.count,this.boundingBox=e.boundingBox!==null?e.boundingBox.clone():null,this.boundingSphere=e.boundingSphere!==null?e.boundingSphere.clone():null,this}getColorAt(e,t){return this.instanceColor===null?t.setRGB(1,1,1):t.fromArray(this.instanceColor.array,e*3)}getMatrixAt(e,t){return t.fromArray(this.instanceMatrix.array,e*16)}getMorphAt(e,t){let n=t.morphTargetInfluences,i=this.morphTexture.source.data.data,r=n.length+1,o=e*r+1;for(let a=0;a<n.length;a++)n[a]=i[o+a]}raycast(e,t){let n=this.matrixWorld,i=this.count;if(Xr.geometry=this.geometry,Xr.material=this.material,Xr.material!==void 0&&(this.boundingSphere===null&&this.computeBoundingSphere(),qr.copy(this.boundingSphere),qr.applyMatrix4(n),e.ray.intersectsSphere(qr)!==!1))for(let r=0;r<i;r++){this.getMatrixAt(r,js),yf.multiplyMatrices(n,js),Xr.matrixWorld=yf,Xr.raycast(e,ma);for(let o=0,a=ma.length;o<a;o++){let l=ma[o];l.instanceId=r,l.object=this,t.push(l)}ma.length=0}}setColorAt(e,t){return this.instanceColor===null&&(this.instanceColor=new vi(new Float32Array(this.instanceMatrix.count*3).fill(1),3)),t.toArray(this.instanceColor.array,e*3),this}setMatrixAt(e,t){return t.toArray(this.instanceMatrix.array,e*16),this}setMorphAt(e,t){let n=t.morphTargetInfluences,i=n.length+1;this.morphTexture===null&&(this.morphTexture=new dr(new Float32Array(i*this.count),i,this.count,rl,_n));let r=this.morphTexture.source.data.data,o=0;for(let c=0;c<n.length;c++)o+=n[c];let a=this.geometry.morphTargetsRelative?1:1-o,l=i*e;return r[l]=a,r.set(n,l+1),this}updateMorphTargets(){}dispose(){super.dispose(),this.instanceMatrix.dispose(),this.instanceColor!==null&&this.instanceColor.dispose(),this.morphTexture!==null&&(this.morphTexture.dispose(),this.morphTexture=null)}},cs=new un,W0=new ye(.5,.5),ga=new S,Vi=class{constructor(e=new $t,t=new $t,n=new $t,i=new $t,r=new $t,o=new $t){this.planes=[e,t,n,i,r,o]}set(e,t,n,i,r,o){let a=this.planes;return a[0].copy(e),a[1].copy(t),a[2].copy(n),a[3].copy(i),a[4].copy(r),a[5].copy(o),this}copy(e){let t=this.planes;for(let n=0;n<6;n++)t[n].copy(e.planes[n]);return this}setFromProjectionMatrix(e,t=Pn,n=!1){let i=this.planes,r=e.elements,o=r[0],a=r[1],l=r[2],c=r[3],h=r[4],u=r[5],d=r[6],f=r[7],g=r[8],y=r[9],p=r[10],m=r[11],b=r[12],E=r[13],M=r[14],R=r[15];if(i[0].setComponents(c-o,f-h,m-g,R-b).normalize(),i[1].setComponents(c+o,f+h,m+g,R+b).normalize(),i[2].setComponents(c+a,f+u,m+y,R+E).normalize(),i[3].setComponents(c-a,f-u,m-y,R-E).normalize(),n)i[4].setComponents(l,d,p,M).normalize(),i[5].setComponents(c-l,f-d,m-p,R-M).normalize();else if(i[4].setComponents(c-l,f-d,m-p,R-M).normalize(),t===Pn)i[5].setComponents(c+l,f+d,m+p,R+M).normalize();else if(t===sr)i[5].setComponents(l,d,p,M).normalize();else throw new Error("THREE.Frustum.setFromProjectionMatrix(): Invalid coordinate system: "+t);return this}intersectsObject(e){if(e.boundingSphere!==void 0)e.boundingSphere===null&&e.computeBoundingSphere(),cs.copy(e.boundingSphere).applyMatrix4(e.matrixWorld);else{let t=e.geometry;t.boundingSphere===null&&t.computeBoundingSphere(),cs.copy(t.boundingSphere).applyMatrix4(e.matrixWorld)}return this.intersectsSphere(cs)}intersectsSprite(e){cs.center.set(0,0,0);let t=W0.distanceTo(e.center);return cs.radius=.7071067811865476+t,cs.applyMatrix4(e.matrixWorld),this.intersectsSphere(cs)}intersectsSphere(e){let t=this.planes,n=e.center,i=-e.radius;for(let r=0;r<6;r++)if(t[r].distanceToPoint(n)<i)return!1;return!0}intersectsBox(e){let t=this.planes;for(let n=0;n<6;n++){let i=t[n];if(ga.x=i.normal.x>0?e.max.x:e.min.x,ga.y=i.normal.y>0?e.max.y:e.min.y,ga.z=i.normal.z>0?e.max.z:e.min.z,i.distanceToPoint(ga)<0)return!1}return!0}containsPoint(e){let t=this.planes;for(let n=0;n<6;n++)if(t[n].distanceToPoint(e)<0)return!1;return!0}clone(){return new this.constructor().copy(this)}},_f=new _e,ka=class s{constructor(){this.coordinateSystem=Pn,this._frustums=[],this._count=0}setFromArrayCamera(e){let t=e.cameras,n=this._frustums;for(let i=0;i<t.length;i++){let r=t[i];_f.multiplyMatrices(r.projectionMatrix,r.matrixWorldInverse),n[i]===void 0&&(n[i]=new Vi),n[i].setFromProjectionMatrix(_f,r.coordinateSystem,r.reversedDepth)}return this._count=t.length,this}getFrustum(e){return this._frustums[e]}intersectsObject(e){let t=this._frustums;for(let n=0;n<this._count;n++)if(t[n].intersectsObject(e))return!0;return!1}intersectsSprite(e){let t=this._frustums;for(let n=0;n<this._count;n++)if(t[n].intersectsSprite(e))return!0;return!1}intersectsSphere(e){let t=this._frustums;for(let n=0;n<this._count;n++)if(t[n].intersectsSphere(e))return!0;return!1}intersectsBox(e){let t=this._frustums;for(let n=0;n<this._count;n++)if(t[n].intersectsBox(e))return!0;return!1}containsPoint(e){let t=this._frustums;for(let n=0;n<this._count;n++)if(t[n].containsPoint(e))return!0;return!1}copy(e){this.coordinateSystem=e.coordinateSystem;let t=this._frustums,n=e._frustums;for(let i=0;i<e._count;i++)t[i]===void 0&&(t[i]=new Vi),t[i].copy(n[i]);return this._count=e._count,this}clone(){return new s().copy(this)}};var Ot=class extends Yt{constructor(e){super(),this.isLineBasicMaterial=!0,this.type="LineBasicMaterial",this.color=new ve(16777215),this.map=null,this.linewidth=1,this.linecap="round",this.linejoin="round",this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.linewidth=e.linewidth,this.linecap=e.linecap,this.linejoin=e.linejoin,this.fog=e.fog,this}},Ba=new S,za=new S,bf=new _e,$r=new Zn,xa=new un,Ph=new S,Mf=new S,In=class extends it{constructor(e=new Ye,t=new Ot){super(),this.isLine=!0,this.type="Line",this.geometry=e,this.material=t,this.morphTargetDictionary=void 0,this.morphTargetInfluences=void 0,this.updateMorphTargets()}copy(e,t){return super.copy(e,t),e.morphTargetInfluences!==void 0?this.morphTargetInfluences=e.morphTargetInfluences.slice():this.morphTargetInfluences=void 0,e.morphTargetDictionary!==void 0?this.morphTargetDictionary=Object.assign({},e.morphTargetDictionary):this.morphTargetDictionary=void 0,this.material=Array.isArray(e.material)?e.material.slice():e.material,this.geometry=e.geometry,this}computeLineDistances(){let e=this.geometry;if(e.index===null){let t=e.attributes.position,n=[0];for(let i=1,r=t.count;i<r;i++)Ba.fromBufferAttribute(t,i-1),za.fromBufferAttribute(t,i),n[i]=n[i-1],n[i]+=Ba.distanceTo(za);e.setAttribute("lineDistance",new Ue(n,1))}else Ee("Line.computeLineDistances(): Computation only possible with non-indexed BufferGeometry.");return this}intersectsFrustum(e){return e.intersectsObject(this)}raycast(e,t){let n=this.geometry,i=this.matrixWorld,r=e.params.Line.threshold,o=n.drawRange;if(n.boundingSphere===null&&n.computeBoundingSphere(),xa.copy(n.boundingSphere),xa.applyMatrix4(i),xa.radius+=r,e.ray.intersectsSphere(xa)===!1)return;bf.copy(i).invert(),$r.copy(e.ray).applyMatrix4(bf);let a=r/((this.scale.x+this.scale.y+this.scale.z)/3),l=a*a,c=this.isLineSegments?2:1,h=n.index,d=n.attributes.position;if(h!==null){let f=Math.max(0,o.start),g=Math.min(h.count,o.start+o.count);for(let y=f,p=g-1;y<p;y+=c){let m=h.getX(y),b=h.getX(y+1),E=ya(this,e,$r,l,m,b,y);E&&t.push(E)}if(this.isLineLoop){let y=h.getX(g-1),p=h.getX(f),m=ya(this,e,$r,l,y,p,g-1);m&&t.push(m)}}else{let f=Math.max(0,o.start),g=Math.min(d.count,o.start+o.count);for(let y=f,p=g-1;y<p;y+=c){let m=ya(this,e,$r,l,y,y+1,y);m&&t.push(m)}if(this.isLineLoop){let y=ya(this,e,$r,l,g-1,f,g-1);y&&t.push(y)}}}updateMorphTargets(){let t=this.geometry.morphAttributes,n=Object.keys(t);if(n.length>0){let i=t[n[0]];if(i!==void 0){this.morphTargetInfluences=[],this.morphTargetDictionary={};for(let r=0,o=i.length;r<o;r++){let a=i[r].name||String(r);this.morphTargetInfluences.push(0),this.morphTargetDictionary[a]=r}}}}};function ya(s,e,t,n,i,r,o){let a=s.geometry.attributes.position;if(Ba.fromBufferAttribute(a,i),za.fromBufferAttribute(a,r),t.distanceSqToSegment(Ba,za,Ph,Mf)>n)return;Ph.applyMatrix4(s.matrixWorld);let c=e.ray.origin.distanceTo(Ph);if(!(c<e.near||c>e.far))return{distance:c,point:Mf.clone().applyMatrix4(s.matrixWorld),index:o,face:null,faceIndex:null,barycoord:null,object:s}}var wf=new S,Sf=new S,vn=class extends In{constructor(e,t){super(e,t),this.isLineSegments=!0,this.type="LineSegments"}computeLineDistances(){let e=this.geometry;if(e.index===null){let t=e.attributes.position,n=[];for(let i=0,r=t.count;i<r;i+=2)wf.fromBufferAttribute(t,i),Sf.fromBufferAttribute(t,i+1),n[i]=i===0?0:n[i-1],n[i+1]=n[i]+wf.distanceTo(Sf);e.setAttribute("lineDistance",new Ue(n,1))}else Ee("LineSegments.computeLineDistances(): Computation only possible with non-indexed BufferGeometry.");return this}},so=class extends In{constructor(e,t){super(e,t),this.isLineLoop=!0,this.type="LineLoop"}},Wi=class extends Yt{constructor(e){super(),this.isPointsMaterial=!0,this.type="PointsMaterial",this.color=new ve(16777215),this.map=null,this.alphaMap=null,this.size=1,this.sizeAttenuation=!0,this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.alphaMap=e.alphaMap,this.size=e.size,this.sizeAttenuation=e.sizeAttenuation,this.fog=e.fog,this}},Tf=new _e,zh=new Zn,va=new un,_a=new S,ms=class extends it{constructor(e=new Ye,t=new Wi){super(),this.isPoints=!0,this.type="Points",this.geometry=e,this.material=t,this.morphTargetDictionary=void 0,this.morphTargetInfluences=void 0,this.updateMorphTargets()}copy(e,t){return super.copy(e,t),e.morphTargetInfluences!==void 0?this.morphTargetInfluences=e.morphTargetInfluences.slice():this.morphTargetInfluences=void 0,e.morphTargetDictionary!==void 0?this.morphTargetDictionary=Object.assign({},e.morphTargetDictionary):this.morphTargetDictionary=void 0,this.material=Array.isArray(e.material)?e.material.slice():e.material,this.geometry=e.geometry,this}intersectsFrustum(e){return e.intersectsObject(this)}raycast(e,t){let n=this.geometry,i=this.matrixWorld,r=e.params.Points.threshold,o=n.drawRange;if(n.boundingSphere===null&&n.computeBoundingSphere(),va.copy(n.boundingSphere),va.applyMatrix4(i),va.radius+=r,e.ray.intersectsSphere(va)===!1)return;Tf.copy(i).invert(),zh.copy(e.ray).applyMatrix4(Tf);let a=r/((this.scale.x+this.scale.y+this.scale.z)/3),l=a*a,c=n.index,u=n.attributes.position;if(c!==null){let d=Math.max(0,o.start),f=Math.min(c.count,o.start+o.count);for(let g=d,y=f;g<y;g++){let p=c.getX(g);_a.fromBufferAttribute(u,p),Af(_a,p,l,i,e,t,this)}}else{let d=Math.max(0,o.start),f=Math.min(u.count,o.start+o.count);for(let g=d,y=f;g<y;g++)_a.fromBufferAttribute(u,g),Af(_a,g,l,i,e,t,this)}}updateMorphTargets(){let t=this.geometry.morphAttributes,n=Object.keys(t);if(n.length>0){let i=t[n[0]];if(i!==void 0){this.morphTargetInfluences=[],this.morphTargetDictionary={};for(let r=0,o=i.length;r<o;r++){let a=i[r].name||String(r);this.morphTargetInfluences.push(0),this.morphTargetDictionary[a]=r}}}}};function Af(s,e,t,n,i,r,o){let a=zh.distanceSqToPoint(s);if(a<t){let l=new S;zh.closestPointToPoint(s,l),l.applyMatrix4(n);let c=i.ray.origin.distanceTo(l);if(c<i.near||c>i.far)return;r.push({distance:c,distanceToRay:Math.sqrt(a),point:l,index:e,face:null,faceIndex:null,barycoord:null,object:o})}}var ro=class extends Nt{constructor(e=[],t=Ss,n,i,r,o,a,l,c,h){super(e,t,n,i,r,o,a,l,c,h),this.isCubeTexture=!0,this.flipY=!1}get images(){return this.image}set images(e){this.image=e}},bi=class extends Nt{constructor(e,t,n,i,r,o,a,l,c){super(e,t,n,i,r,o,a,l,c),this.isCanvasTexture=!0,this.needsUpdate=!0}};var zn=class extends Nt{constructor(e,t,n=Vn,i,r,o,a=gt,l=gt,c,h=xi,u=1){if(h!==xi&&h!==Ei)throw new Error("THREE.DepthTexture: format must be either THREE.DepthFormat or THREE.DepthStencilFormat");let d={width:e,height:t,depth:u};super(d,i,r,o,a,l,h,n,c),this.isDepthTexture=!0,this.flipY=!1,this.generateMipmaps=!1,this.compareFunction=null}copy(e){return super.copy(e),this.source=new ar(Object.assign({},e.image)),this.compareFunction=e.compareFunction,this}toJSON(e){let t=super.toJSON(e);return t.compareFunction=this.compareFunction,t}},oo=class extends zn{constructor(e,t=Vn,n=Ss,i,r,o=gt,a=gt,l,c=xi){let h={width:e,height:e,depth:1},u=[h,h,h,h,h,h];super(e,e,t,n,i,r,o,a,l,c),this.image=u,this.isCubeDepthTexture=!0,this.isCubeTexture=!0}get images(){return this.image}set images(e){this.image=e}},ao=class extends Nt{constructor(e=null){super(),this.sourceTexture=e,this.isExternalTexture=!0}copy(e){return super.copy(e),this.sourceTexture=e.sourceTexture,this}},ln=class s extends Ye{constructor(e=1,t=1,n=1,i=1,r=1,o=1){super(),this.type="BoxGeometry",this.parameters={width:e,height:t,depth:n,widthSegments:i,heightSegments:r,depthSegments:o};let a=this;i=Math.floor(i),r=Math.floor(r),o=Math.floor(o);let l=[],c=[],h=[],u=[],d=0,f=0;g("z","y","x",-1,-1,n,t,e,o,r,0),g("z","y","x",1,-1,n,t,-e,o,r,1),g("x","z","y",1,1,e,n,t,i,o,2),g("x","z","y",1,-1,e,n,-t,i,o,3),g("x","y","z",1,-1,e,t,n,i,r,4),g("x","y","z",-1,-1,e,t,-n,i,r,5),this.setIndex(l),this.setAttribute("position",new Ue(c,3)),this.setAttribute("normal",new Ue(h,3)),this.setAttribute("uv",new Ue(u,2));function g(y,p,m,b,E,M,R,T,x,w,O){let I=M/x,N=R/w,k=M/2,V=R/2,P=T/2,G=x+1,q=w+1,H=0,te=0,X=new S;for(let J=0;J<q;J++){let Q=J*N-V;for(let Te=0;Te<G;Te++){let Be=Te*I-k;X[y]=Be*b,X[p]=Q*E,X[m]=P,c.push(X.x,X.y,X.z),X[y]=0,X[p]=0,X[m]=T>0?1:-1,h.push(X.x,X.y,X.z),u.push(Te/x),u.push(1-J/w),H+=1}}for(let J=0;J<w;J++)for(let Q=0;Q<x;Q++){let Te=d+Q+G*J,Be=d+Q+G*(J+1),K=d+(Q+1)+G*(J+1),me=d+(Q+1)+G*J;l.push(Te,Be,me),l.push(Be,K,me),te+=6}a.addGroup(f,te,O),f+=te,d+=H}}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.width,e.height,e.depth,e.widthSegments,e.heightSegments,e.depthSegments)}};var Xi=class s extends Ye{constructor(e=1,t=32,n=0,i=Math.PI*2){super(),this.type="CircleGeometry",this.parameters={radius:e,segments:t,thetaStart:n,thetaLength:i},t=Math.max(3,t);let r=[],o=[],a=[],l=[],c=new S,h=new ye;o.push(0,0,0),a.push(0,0,1),l.push(.5,.5);for(let u=0,d=3;u<=t;u++,d+=3){let f=n+u/t*i;c.x=e*Math.cos(f),c.y=e*Math.sin(f),o.push(c.x,c.y,c.z),a.push(0,0,1),h.x=(o[d]/e+1)/2,h.y=(o[d+1]/e+1)/2,l.push(h.x,h.y)}for(let u=1;u<=t;u++)r.push(u,u+1,0);this.setIndex(r),this.setAttribute("position",new Ue(o,3)),this.setAttribute("normal",new Ue(a,3)),this.setAttribute("uv",new Ue(l,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.radius,e.segments,e.thetaStart,e.thetaLength)}},tn=class s extends Ye{constructor(e=1,t=1,n=1,i=32,r=1,o=!1,a=0,l=Math.PI*2){super(),this.type="CylinderGeometry",this.parameters={radiusTop:e,radiusBottom:t,height:n,radialSegments:i,heightSegments:r,openEnded:o,thetaStart:a,thetaLength:l};let c=this;i=Math.floor(i),r=Math.floor(r);let h=[],u=[],d=[],f=[],g=0,y=[],p=n/2,m=0;b(),o===!1&&(e>0&&E(!0),t>0&&E(!1)),this.setIndex(h),this.setAttribute("position",new Ue(u,3)),this.setAttribute("normal",new Ue(d,3)),this.setAttribute("uv",new Ue(f,2));function b(){let M=new S,R=new S,T=0,x=(t-e)/n;for(let w=0;w<=r;w++){let O=[],I=w/r,N=I*(t-e)+e;for(let k=0;k<=i;k++){let V=k/i,P=V*l+a,G=Math.sin(P),q=Math.cos(P);R.x=N*G,R.y=-I*n+p,R.z=N*q,u.push(R.x,R.y,R.z),M.set(G,x,q).normalize(),d.push(M.x,M.y,M.z),f.push(V,1-I),O.push(g++)}y.push(O)}for(let w=0;w<i;w++)for(let O=0;O<r;O++){let I=y[O][w],N=y[O+1][w],k=y[O+1][w+1],V=y[O][w+1];(e>0||O!==0)&&(h.push(I,N,V),T+=3),(t>0||O!==r-1)&&(h.push(N,k,V),T+=3)}c.addGroup(m,T,0),m+=T}function E(M){let R=g,T=new ye,x=new S,w=0,O=M===!0?e:t,I=M===!0?1:-1;for(let k=1;k<=i;k++)u.push(0,p*I,0),d.push(0,I,0),f.push(.5,.5),g++;let N=g;for(let k=0;k<=i;k++){let P=k/i*l+a,G=Math.cos(P),q=Math.sin(P);x.x=O*q,x.y=p*I,x.z=O*G,u.push(x.x,x.y,x.z),d.push(0,I,0),T.x=G*.5+.5,T.y=q*.5*I+.5,f.push(T.x,T.y),g++}for(let k=0;k<i;k++){let V=R+k,P=N+k;M===!0?h.push(P,P+1,V):h.push(P+1,P,V),w+=3}c.addGroup(m,w,M===!0?1:2),m+=w}}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.radiusTop,e.radiusBottom,e.height,e.radialSegments,e.heightSegments,e.openEnded,e.thetaStart,e.thetaLength)}},fr=class s extends tn{constructor(e=1,t=1,n=32,i=1,r=!1,o=0,a=Math.PI*2){super(0,e,t,n,i,r,o,a),this.type="ConeGeometry",this.parameters={radius:e,height:t,radialSegments:n,heightSegments:i,openEnded:r,thetaStart:o,thetaLength:a}}static fromJSON(e){return new s(e.radius,e.height,e.radialSegments,e.heightSegments,e.openEnded,e.thetaStart,e.thetaLength)}};var ba=new S,Ma=new S,Ih=new S,wa=new Yn,lo=class extends Ye{constructor(e=null,t=1){if(super(),this.type="EdgesGeometry",this.parameters={geometry:e,thresholdAngle:t},e!==null){let i=Math.pow(10,4),r=Math.cos(er*t),o=e.getIndex(),a=e.getAttribute("position"),l=o?o.count:a.count,c=[0,0,0],h=["a","b","c"],u=new Array(3),d=new Map,f=[];for(let g=0;g<l;g+=3){o?(c[0]=o.getX(g),c[1]=o.getX(g+1),c[2]=o.getX(g+2)):(c[0]=g,c[1]=g+1,c[2]=g+2);let{a:y,b:p,c:m}=wa;if(y.fromBufferAttribute(a,c[0]),p.fromBufferAttribute(a,c[1]),m.fromBufferAttribute(a,c[2]),wa.getNormal(Ih),u[0]=`${Math.round(y.x*i)},${Math.round(y.y*i)},${Math.round(y.z*i)}`,u[1]=`${Math.round(p.x*i)},${Math.round(p.y*i)},${Math.round(p.z*i)}`,u[2]=`${Math.round(m.x*i)},${Math.round(m.y*i)},${Math.round(m.z*i)}`,!(u[0]===u[1]||u[1]===u[2]||u[2]===u[0]))for(let b=0;b<3;b++){let E=(b+1)%3,M=u[b],R=u[E],T=wa[h[b]],x=wa[h[E]],w=`${M}_${R}`,O=`${R}_${M}`,I=d.get(O);I?(Ih.dot(I.normal)<=r&&(f.push(T.x,T.y,T.z),f.push(x.x,x.y,x.z)),d.set(O,null)):d.has(w)||d.set(w,{index0:c[b],index1:c[E],normal:Ih.clone()})}}for(let g of d.values())if(g){let{index0:y,index1:p}=g;ba.fromBufferAttribute(a,y),Ma.fromBufferAttribute(a,p),f.push(ba.x,ba.y,ba.z),f.push(Ma.x,Ma.y,Ma.z)}this.setAttribute("position",new Ue(f,3))}}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}};var Vt=class s extends Ye{constructor(e=1,t=1,n=1,i=1){super(),this.type="PlaneGeometry",this.parameters={width:e,height:t,widthSegments:n,heightSegments:i};let r=e/2,o=t/2,a=Math.floor(n),l=Math.floor(i),c=a+1,h=l+1,u=e/a,d=t/l,f=[],g=[],y=[],p=[];for(let m=0;m<h;m++){let b=m*d-o;for(let E=0;E<c;E++){let M=E*u-r;g.push(M,-b,0),y.push(0,0,1),p.push(E/a),p.push(1-m/l)}}for(let m=0;m<l;m++)for(let b=0;b<a;b++){let E=b+c*m,M=b+c*(m+1),R=b+1+c*(m+1),T=b+1+c*m;f.push(E,M,T),f.push(M,R,T)}this.setIndex(f),this.setAttribute("position",new Ue(g,3)),this.setAttribute("normal",new Ue(y,3)),this.setAttribute("uv",new Ue(p,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.width,e.height,e.widthSegments,e.heightSegments)}},qi=class s extends Ye{constructor(e=.5,t=1,n=32,i=1,r=0,o=Math.PI*2){super(),this.type="RingGeometry",this.parameters={innerRadius:e,outerRadius:t,thetaSegments:n,phiSegments:i,thetaStart:r,thetaLength:o},n=Math.max(3,n),i=Math.max(1,i);let a=[],l=[],c=[],h=[],u=e,d=(t-e)/i,f=new S,g=new ye;for(let y=0;y<=i;y++){for(let p=0;p<=n;p++){let m=r+p/n*o;f.x=u*Math.cos(m),f.y=u*Math.sin(m),l.push(f.x,f.y,f.z),c.push(0,0,1),g.x=(f.x/t+1)/2,g.y=(f.y/t+1)/2,h.push(g.x,g.y)}u+=d}for(let y=0;y<i;y++){let p=y*(n+1);for(let m=0;m<n;m++){let b=m+p,E=b,M=b+n+1,R=b+n+2,T=b+1;a.push(E,M,T),a.push(M,R,T)}}this.setIndex(a),this.setAttribute("position",new Ue(l,3)),this.setAttribute("normal",new Ue(c,3)),this.setAttribute("uv",new Ue(h,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.innerRadius,e.outerRadius,e.thetaSegments,e.phiSegments,e.thetaStart,e.thetaLength)}};var Hn=class s extends Ye{constructor(e=1,t=32,n=16,i=0,r=Math.PI*2,o=0,a=Math.PI){super(),this.type="SphereGeometry",this.parameters={radius:e,widthSegments:t,heightSegments:n,phiStart:i,phiLength:r,thetaStart:o,thetaLength:a},t=Math.max(3,Math.floor(t)),n=Math.max(2,Math.floor(n));let l=Math.min(o+a,Math.PI),c=0,h=[],u=new S,d=new S,f=[],g=[],y=[],p=[];for(let m=0;m<=n;m++){let b=[],E=m/n,M=o+E*a,R=e*Math.cos(M),T=Math.sqrt(e*e-R*R),x=0;m===0&&o===0?x=.5/t:m===n&&l===Math.PI&&(x=-.5/t);for(let w=0;w<=t;w++){let O=w/t,I=i+O*r;u.x=-T*Math.cos(I),u.y=R,u.z=T*Math.sin(I),g.push(u.x,u.y,u.z),d.copy(u).normalize(),y.push(d.x,d.y,d.z),p.push(O+x,1-E),b.push(c++)}h.push(b)}for(let m=0;m<n;m++)for(let b=0;b<t;b++){let E=h[m][b+1],M=h[m][b],R=h[m+1][b],T=h[m+1][b+1];(m!==0||o>0)&&f.push(E,M,T),(m!==n-1||l<Math.PI)&&f.push(M,R,T)}this.setIndex(f),this.setAttribute("position",new Ue(g,3)),this.setAttribute("normal",new Ue(y,3)),this.setAttribute("uv",new Ue(p,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.radius,e.widthSegments,e.heightSegments,e.phiStart,e.phiLength,e.thetaStart,e.thetaLength)}};var gs=class s extends Ye{constructor(e=1,t=.4,n=12,i=48,r=Math.PI*2,o=0,a=Math.PI*2){super(),this.type="TorusGeometry",this.parameters={radius:e,tube:t,radialSegments:n,tubularSegments:i,arc:r,thetaStart:o,thetaLength:a},n=Math.floor(n),i=Math.floor(i);let l=[],c=[],h=[],u=[],d=new S,f=new S,g=new S;for(let y=0;y<=n;y++){let p=o+y/n*a;for(let m=0;m<=i;m++){let b=m/i*r;f.x=(e+t*Math.cos(p))*Math.cos(b),f.y=(e+t*Math.cos(p))*Math.sin(b),f.z=t*Math.sin(p),c.push(f.x,f.y,f.z),d.x=e*Math.cos(b),d.y=e*Math.sin(b),g.subVectors(f,d).normalize(),h.push(g.x,g.y,g.z),u.push(m/i),u.push(y/n)}}for(let y=1;y<=n;y++)for(let p=1;p<=i;p++){let m=(i+1)*y+p-1,b=(i+1)*(y-1)+p-1,E=(i+1)*(y-1)+p,M=(i+1)*y+p;l.push(m,b,M),l.push(b,E,M)}this.setIndex(l),this.setAttribute("position",new Ue(c,3)),this.setAttribute("normal",new Ue(h,3)),this.setAttribute("uv",new Ue(u,2))}copy(e){return super.copy(e),this.parameters=Object.assign({},e.parameters),this}static fromJSON(e){return new s(e.radius,e.tube,e.radialSegments,e.tubularSegments,e.arc,e.thetaStart,e.thetaLength)}};var co=class extends Yt{constructor(e){super(),this.isShadowMaterial=!0,this.type="ShadowMaterial",this.color=new ve(0),this.transparent=!0,this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.fog=e.fog,this}};function Es(s){let e={};for(let t in s){e[t]={};for(let n in s[t]){let i=s[t][n];if(Ef(i))i.isRenderTargetTexture?(Ee("UniformsUtils: Textures of render targets cannot be cloned via cloneUniforms() or mergeUniforms()."),e[t][n]=null):e[t][n]=i.clone();else if(Array.isArray(i))if(Ef(i[0])){let r=[];for(let o=0,a=i.length;o<a;o++)r[o]=i[o].clone();e[t][n]=r}else e[t][n]=i.slice();else e[t][n]=i}}return e}function nn(s){let e={};for(let t=0;t<s.length;t++){let n=Es(s[t]);for(let i in n)e[i]=n[i]}return e}function Ef(s){return s&&(s.isColor||s.isMatrix3||s.isMatrix4||s.isVector2||s.isVector3||s.isVector4||s.isTexture||s.isQuaternion)}function X0(s){let e=[];for(let t=0;t<s.length;t++)e.push(s[t].clone());return e}function wu(s){let e=s.getRenderTarget();return e===null?s.outputColorSpace:e.isXRRenderTarget===!0?e.texture.colorSpace:Xe.workingColorSpace}var Sp={clone:Es,merge:nn},q0=`void main() {
	gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 );
}`,$0=`void main() {
	gl_FragColor = vec4( 1.0, 0.0, 0.0, 1.0 );
}`,dn=class extends Yt{constructor(e){super(),this.isShaderMaterial=!0,this.type="ShaderMaterial",this.defines={},this.uniforms={},this.uniformsGroups=[],this.vertexShader=q0,this.fragmentShader=$0,this.linewidth=1,this.wireframe=!1,this.wireframeLinewidth=1,this.fog=!1,this.lights=!1,this.clipping=!1,this.forceSinglePass=!0,this.extensions={clipCullDistance:!1,multiDraw:!1},this.defaultAttributeValues={color:[1,1,1],uv:[0,0],uv1:[0,0]},this.index0AttributeName=void 0,this.uniformsNeedUpdate=!1,this.glslVersion=null,e!==void 0&&this.setValues(e)}copy(e){return super.copy(e),this.fragmentShader=e.fragmentShader,this.vertexShader=e.vertexShader,this.uniforms=Es(e.uniforms),this.uniformsGroups=X0(e.uniformsGroups),this.defines=Object.assign({},e.defines),this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.fog=e.fog,this.lights=e.lights,this.clipping=e.clipping,this.extensions=Object.assign({},e.extensions),this.glslVersion=e.glslVersion,this.defaultAttributeValues=Object.assign({},e.defaultAttributeValues),this.index0AttributeName=e.index0AttributeName,this.uniformsNeedUpdate=e.uniformsNeedUpdate,this}toJSON(e){let t=super.toJSON(e);t.glslVersion=this.glslVersion,t.uniforms={};for(let i in this.uniforms){let o=this.uniforms[i].value;o&&o.isTexture?t.uniforms[i]={type:"t",value:o.toJSON(e).uuid}:o&&o.isColor?t.uniforms[i]={type:"c",value:o.getHex()}:o&&o.isVector2?t.uniforms[i]={type:"v2",value:o.toArray()}:o&&o.isVector3?t.uniforms[i]={type:"v3",value:o.toArray()}:o&&o.isVector4?t.uniforms[i]={type:"v4",value:o.toArray()}:o&&o.isMatrix3?t.uniforms[i]={type:"m3",value:o.toArray()}:o&&o.isMatrix4?t.uniforms[i]={type:"m4",value:o.toArray()}:t.uniforms[i]={value:o}}Object.keys(this.defines).length>0&&(t.defines=this.defines),t.vertexShader=this.vertexShader,t.fragmentShader=this.fragmentShader,t.lights=this.lights,t.clipping=this.clipping;let n={};for(let i in this.extensions)this.extensions[i]===!0&&(n[i]=!0);return Object.keys(n).length>0&&(t.extensions=n),t}fromJSON(e,t){if(super.fromJSON(e,t),e.uniforms!==void 0)for(let n in e.uniforms){let i=e.uniforms[n];switch(this.uniforms[n]={},i.type){case"t":this.uniforms[n].value=t[i.value]||null;break;case"c":this.uniforms[n].value=new ve().setHex(i.value);break;case"v2":this.uniforms[n].value=new ye().fromArray(i.value);break;case"v3":this.uniforms[n].value=new S().fromArray(i.value);break;case"v4":this.uniforms[n].value=new at().fromArray(i.value);break;case"m3":this.uniforms[n].value=new Fe().fromArray(i.value);break;case"m4":this.uniforms[n].value=new _e().fromArray(i.value);break;default:this.uniforms[n].value=i.value}}if(e.defines!==void 0&&(this.defines=e.defines),e.vertexShader!==void 0&&(this.vertexShader=e.vertexShader),e.fragmentShader!==void 0&&(this.fragmentShader=e.fragmentShader),e.glslVersion!==void 0&&(this.glslVersion=e.glslVersion),e.extensions!==void 0)for(let n in e.extensions)this.extensions[n]=e.extensions[n];return e.lights!==void 0&&(this.lights=e.lights),e.clipping!==void 0&&(this.clipping=e.clipping),this}},Ha=class extends dn{constructor(e){super(e),this.isRawShaderMaterial=!0,this.type="RawShaderMaterial"}},Mt=class extends Yt{constructor(e){super(),this.isMeshStandardMaterial=!0,this.type="MeshStandardMaterial",this.defines={STANDARD:""},this.color=new ve(16777215),this.roughness=1,this.metalness=0,this.map=null,this.lightMap=null,this.lightMapIntensity=1,this.aoMap=null,this.aoMapIntensity=1,this.emissive=new ve(0),this.emissiveIntensity=1,this.emissiveMap=null,this.bumpMap=null,this.bumpScale=1,this.normalMap=null,this.normalMapType=Co,this.normalScale=new ye(1,1),this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.roughnessMap=null,this.metalnessMap=null,this.alphaMap=null,this.envMap=null,this.envMapRotation=new jn,this.envMapIntensity=1,this.wireframe=!1,this.wireframeLinewidth=1,this.wireframeLinecap="round",this.wireframeLinejoin="round",this.flatShading=!1,this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.defines={STANDARD:""},this.color.copy(e.color),this.roughness=e.roughness,this.metalness=e.metalness,this.map=e.map,this.lightMap=e.lightMap,this.lightMapIntensity=e.lightMapIntensity,this.aoMap=e.aoMap,this.aoMapIntensity=e.aoMapIntensity,this.emissive.copy(e.emissive),this.emissiveMap=e.emissiveMap,this.emissiveIntensity=e.emissiveIntensity,this.bumpMap=e.bumpMap,this.bumpScale=e.bumpScale,this.normalMap=e.normalMap,this.normalMapType=e.normalMapType,this.normalScale.copy(e.normalScale),this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this.roughnessMap=e.roughnessMap,this.metalnessMap=e.metalnessMap,this.alphaMap=e.alphaMap,this.envMap=e.envMap,this.envMapRotation.copy(e.envMapRotation),this.envMapIntensity=e.envMapIntensity,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.wireframeLinecap=e.wireframeLinecap,this.wireframeLinejoin=e.wireframeLinejoin,this.flatShading=e.flatShading,this.fog=e.fog,this}},cn=class extends Mt{constructor(e){super(),this.isMeshPhysicalMaterial=!0,this.defines={STANDARD:"",PHYSICAL:""},this.type="MeshPhysicalMaterial",this.anisotropyRotation=0,this.anisotropyMap=null,this.clearcoatMap=null,this.clearcoatRoughness=0,this.clearcoatRoughnessMap=null,this.clearcoatNormalScale=new ye(1,1),this.clearcoatNormalMap=null,this.diffuseRoughnessMap=null,this.ior=1.5,Object.defineProperty(this,"reflectivity",{get:function(){return qe(2.5*(this.ior-1)/(this.ior+1),0,1)},set:function(t){this.ior=(1+.4*t)/(1-.4*t)}}),this.iridescenceMap=null,this.iridescenceIOR=1.3,this.iridescenceThicknessMinimum=100,this.iridescenceThicknessMaximum=400,this.iridescenceThicknessMap=null,this.sheenColor=new ve(0),this.sheenColorMap=null,this.sheenRoughness=1,this.sheenRoughnessMap=null,this.transmissionMap=null,this.thickness=0,this.thicknessMap=null,this.attenuationDistance=1/0,this.attenuationColor=new ve(1,1,1),this.specularIntensity=1,this.specularIntensityMap=null,this.specularColor=new ve(1,1,1),this.specularColorMap=null,this._anisotropy=0,this._clearcoat=0,this._diffuseRoughness=0,this._dispersion=0,this._iridescence=0,this._retroreflectivity=0,this._sheen=0,this._transmission=0,this.setValues(e)}get anisotropy(){return this._anisotropy}set anisotropy(e){this._anisotropy>0!=e>0&&this.version++,this._anisotropy=e}get clearcoat(){return this._clearcoat}set clearcoat(e){this._clearcoat>0!=e>0&&this.version++,this._clearcoat=e}get diffuseRoughness(){return this._diffuseRoughness}set diffuseRoughness(e){this._diffuseRoughness>0!=e>0&&this.version++,this._diffuseRoughness=e}get iridescence(){return this._iridescence}set iridescence(e){this._iridescence>0!=e>0&&this.version++,this._iridescence=e}get dispersion(){return this._dispersion}set dispersion(e){this._dispersion>0!=e>0&&this.version++,this._dispersion=e}get retroreflectivity(){return this._retroreflectivity}set retroreflectivity(e){this._retroreflectivity>0!=e>0&&this.version++,this._retroreflectivity=e}get sheen(){return this._sheen}set sheen(e){this._sheen>0!=e>0&&this.version++,this._sheen=e}get transmission(){return this._transmission}set transmission(e){this._transmission>0!=e>0&&this.version++,this._transmission=e}get iridescenceThicknessRange(){return hs('MeshPhysicalMaterial: The "iridescenceThicknessRange" property has been replaced by "iridescenceThicknessMinimum" and "iridescenceThicknessMaximum".'),[this.iridescenceThicknessMinimum,this.iridescenceThicknessMaximum]}set iridescenceThicknessRange(e){hs('MeshPhysicalMaterial: The "iridescenceThicknessRange" property has been replaced by "iridescenceThicknessMinimum" and "iridescenceThicknessMaximum".'),this.iridescenceThicknessMinimum=e[0],this.iridescenceThicknessMaximum=e[1]}copy(e){return super.copy(e),this.defines={STANDARD:"",PHYSICAL:""},this.anisotropy=e.anisotropy,this.anisotropyRotation=e.anisotropyRotation,this.anisotropyMap=e.anisotropyMap,this.clearcoat=e.clearcoat,this.clearcoatMap=e.clearcoatMap,this.clearcoatRoughness=e.clearcoatRoughness,this.clearcoatRoughnessMap=e.clearcoatRoughnessMap,this.clearcoatNormalMap=e.clearcoatNormalMap,this.clearcoatNormalScale.copy(e.clearcoatNormalScale),this.diffuseRoughness=e.diffuseRoughness,this.diffuseRoughnessMap=e.diffuseRoughnessMap,this.dispersion=e.dispersion,this.ior=e.ior,this.iridescence=e.iridescence,this.iridescenceMap=e.iridescenceMap,this.iridescenceIOR=e.iridescenceIOR,this.iridescenceThicknessMinimum=e.iridescenceThicknessMinimum,this.iridescenceThicknessMaximum=e.iridescenceThicknessMaximum,this.iridescenceThicknessMap=e.iridescenceThicknessMap,this.retroreflectivity=e.retroreflectivity,this.sheen=e.sheen,this.sheenColor.copy(e.sheenColor),this.sheenColorMap=e.sheenColorMap,this.sheenRoughness=e.sheenRoughness,this.sheenRoughnessMap=e.sheenRoughnessMap,this.transmission=e.transmission,this.transmissionMap=e.transmissionMap,this.thickness=e.thickness,this.thicknessMap=e.thicknessMap,this.attenuationDistance=e.attenuationDistance,this.attenuationColor.copy(e.attenuationColor),this.specularIntensity=e.specularIntensity,this.specularIntensityMap=e.specularIntensityMap,this.specularColor.copy(e.specularColor),this.specularColorMap=e.specularColorMap,this}};var ho=class extends Yt{constructor(e){super(),this.isMeshLambertMaterial=!0,this.type="MeshLambertMaterial",this.color=new ve(16777215),this.map=null,this.lightMap=null,this.lightMapIntensity=1,this.aoMap=null,this.aoMapIntensity=1,this.emissive=new ve(0),this.emissiveIntensity=1,this.emissiveMap=null,this.bumpMap=null,this.bumpScale=1,this.normalMap=null,this.normalMapType=Co,this.normalScale=new ye(1,1),this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.specularMap=null,this.alphaMap=null,this.envMap=null,this.envMapRotation=new jn,this.combine=Ja,this.reflectivity=1,this.envMapIntensity=1,this.refractionRatio=.98,this.wireframe=!1,this.wireframeLinewidth=1,this.wireframeLinecap="round",this.wireframeLinejoin="round",this.flatShading=!1,this.fog=!0,this.setValues(e)}copy(e){return super.copy(e),this.color.copy(e.color),this.map=e.map,this.lightMap=e.lightMap,this.lightMapIntensity=e.lightMapIntensity,this.aoMap=e.aoMap,this.aoMapIntensity=e.aoMapIntensity,this.emissive.copy(e.emissive),this.emissiveMap=e.emissiveMap,this.emissiveIntensity=e.emissiveIntensity,this.bumpMap=e.bumpMap,this.bumpScale=e.bumpScale,this.normalMap=e.normalMap,this.normalMapType=e.normalMapType,this.normalScale.copy(e.normalScale),this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this.specularMap=e.specularMap,this.alphaMap=e.alphaMap,this.envMap=e.envMap,this.envMapRotation.copy(e.envMapRotation),this.combine=e.combine,this.reflectivity=e.reflectivity,this.envMapIntensity=e.envMapIntensity,this.refractionRatio=e.refractionRatio,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this.wireframeLinecap=e.wireframeLinecap,this.wireframeLinejoin=e.wireframeLinejoin,this.flatShading=e.flatShading,this.fog=e.fog,this}},Ga=class extends Yt{constructor(e){super(),this.isMeshDepthMaterial=!0,this.type="MeshDepthMaterial",this.depthPacking=hp,this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.wireframe=!1,this.wireframeLinewidth=1,this.setValues(e)}copy(e){return super.copy(e),this.depthPacking=e.depthPacking,this.map=e.map,this.alphaMap=e.alphaMap,this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this.wireframe=e.wireframe,this.wireframeLinewidth=e.wireframeLinewidth,this}},Va=class extends Yt{constructor(e){super(),this.isMeshDistanceMaterial=!0,this.type="MeshDistanceMaterial",this.map=null,this.alphaMap=null,this.displacementMap=null,this.displacementScale=1,this.displacementBias=0,this.setValues(e)}copy(e){return super.copy(e),this.map=e.map,this.alphaMap=e.alphaMap,this.displacementMap=e.displacementMap,this.displacementScale=e.displacementScale,this.displacementBias=e.displacementBias,this}};var uo=class extends Ot{constructor(e){super(),this.isLineDashedMaterial=!0,this.type="LineDashedMaterial",this.scale=1,this.dashSize=3,this.gapSize=1,this.setValues(e)}copy(e){return super.copy(e),this.scale=e.scale,this.dashSize=e.dashSize,this.gapSize=e.gapSize,this}};function Bi(s,e){return!s||s.constructor===e?s:typeof e.BYTES_PER_ELEMENT=="number"?new e(s):Array.prototype.slice.call(s)}function Yr(s){return s!==void 0&&s.inTangents!==void 0&&s.outTangents!==void 0}function Y0(s){function e(i,r){return s[i]-s[r]}let t=s.length,n=new Array(t);for(let i=0;i!==t;++i)n[i]=i;return n.sort(e),n}function Rf(s,e,t){let n=s.length,i=new s.constructor(n);for(let r=0,o=0;o!==n;++r){let a=t[r]*e;for(let l=0;l!==e;++l)i[o++]=s[a+l]}return i}function K0(s,e,t,n){let i=1,r=s[0];for(;r!==void 0&&r[n]===void 0;)r=s[i++];if(r===void 0)return;let o=r[n];if(o!==void 0)if(Array.isArray(o))do o=r[n],o!==void 0&&(e.push(r.time),t.push(...o)),r=s[i++];while(r!==void 0);else if(o.toArray!==void 0)do o=r[n],o!==void 0&&(e.push(r.time),o.toArray(t,t.length)),r=s[i++];while(r!==void 0);else do o=r[n],o!==void 0&&(e.push(r.time),t.push(o)),r=s[i++];while(r!==void 0)}var Jn=class{constructor(e,t,n,i){this.parameterPositions=e,this._cachedIndex=0,this.resultBuffer=i!==void 0?i:new t.constructor(n),this.sampleValues=t,this.valueSize=n,this.settings=null,this.DefaultSettings_={}}evaluate(e){let t=this.parameterPositions,n=this._cachedIndex,i=t[n],r=t[n-1];n:{e:{let o;t:{i:if(!(e<i)){for(let a=n+2;;){if(i===void 0){if(e<r)break i;return n=t.length,this._cachedIndex=n,this.copySampleValue_(n-1)}if(n===a)break;if(r=i,i=t[++n],e<i)break e}o=t.length;break t}if(!(e>=r)){let a=t[1];e<a&&(n=2,r=a);for(let l=n-2;;){if(r===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(n===l)break;if(i=r,r=t[--n-1],e>=r)break e}o=n,n=0;break t}break n}for(;n<o;){let a=n+o>>>1;e<t[a]?o=a:n=a+1}if(i=t[n],r=t[n-1],r===void 0)return this._cachedIndex=0,this.copySampleValue_(0);if(i===void 0)return n=t.length,this._cachedIndex=n,this.copySampleValue_(n-1)}this._cachedIndex=n,this.intervalChanged_(n,r,i)}return this.interpolate_(n,r,e,i)}getSettings_(){return this.settings||this.DefaultSettings_}copySampleValue_(e){let t=this.resultBuffer,n=this.sampleValues,i=this.valueSize,r=e*i;for(let o=0;o!==i;++o)t[o]=n[r+o];return t}interpolate_(){throw new Error("THREE.Interpolant: Call to abstract method.")}intervalChanged_(){}},Wa=class extends Jn{constructor(e,t,n,i){super(e,t,n,i),this._weightPrev=-0,this._offsetPrev=-0,this._weightNext=-0,this._offsetNext=-0,this.DefaultSettings_={endingStart:Fh,endingEnd:Fh}}intervalChanged_(e,t,n){let i=this.parameterPositions,r=e-2,o=e+1,a=i[r],l=i[o];if(a===void 0)switch(this.getSettings_().endingStart){case kh:r=e,a=2*t-n;break;case Bh:r=i.length-2,a=t+i[r]-i[r+1];break;default:r=e,a=n}if(l===void 0)switch(this.getSettings_().endingEnd){case kh:o=e,l=2*n-t;break;case Bh:o=1,l=n+i[1]-i[0];break;default:o=e-1,l=t}let c=(n-t)*.5,h=this.valueSize;this._weightPrev=c/(t-a),this._weightNext=c/(l-n),this._offsetPrev=r*h,this._offsetNext=o*h}interpolate_(e,t,n,i){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,l=e*a,c=l-a,h=this._offsetPrev,u=this._offsetNext,d=this._weightPrev,f=this._weightNext,g=(n-t)/(i-t),y=g*g,p=y*g,m=-d*p+2*d*y-d*g,b=(1+d)*p+(-1.5-2*d)*y+(-.5+d)*g+1,E=(-1-f)*p+(1.5+f)*y+.5*g,M=f*p-f*y;for(let R=0;R!==a;++R)r[R]=m*o[h+R]+b*o[c+R]+E*o[l+R]+M*o[u+R];return r}},Xa=class extends Jn{constructor(e,t,n,i){super(e,t,n,i)}interpolate_(e,t,n,i){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,l=e*a,c=l-a,h=(n-t)/(i-t),u=1-h;for(let d=0;d!==a;++d)r[d]=o[c+d]*u+o[l+d]*h;return r}},qa=class extends Jn{constructor(e,t,n,i){super(e,t,n,i)}interpolate_(e){return this.copySampleValue_(e-1)}},$a=class extends Jn{interpolate_(e,t,n,i){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,l=e*a,c=l-a,h=this.inTangents,u=this.outTangents;if(!h||!u){let g=(n-t)/(i-t),y=1-g;for(let p=0;p!==a;++p)r[p]=o[c+p]*y+o[l+p]*g;return r}let d=a*2,f=e-1;for(let g=0;g!==a;++g){let y=o[c+g],p=o[l+g],m=f*d+g*2,b=u[m],E=u[m+1],M=e*d+g*2,R=h[M],T=h[M+1],x=Z0(n,t,b,R,i);r[g]=Tp(x,y,E,T,p)}return r}};function Tp(s,e,t,n,i){let r=1-s;return r*r*r*e+3*r*r*s*t+3*r*s*s*n+s*s*s*i}function j0(s,e,t,n,i){let r=1-s;return 3*r*r*(t-e)+6*r*s*(n-t)+3*s*s*(i-n)}function Z0(s,e,t,n,i){let r=(s-e)/(i-e);for(let o=0;o<8;o++){let a=Tp(r,e,t,n,i)-s;if(Math.abs(a)<1e-10)break;let l=j0(r,e,t,n,i);if(Math.abs(l)<1e-10)break;r=Math.max(0,Math.min(1,r-a/l))}return r}var fn=class{constructor(e,t,n,i){if(e===void 0)throw new Error("THREE.KeyframeTrack: track name is undefined");if(t===void 0||t.length===0)throw new Error("THREE.KeyframeTrack: no keyframes in track named "+e);this.name=e,this.times=Bi(t,this.TimeBufferType),this.values=Bi(n,this.ValueBufferType),this.setInterpolation(i||this.DefaultInterpolation)}static toJSON(e){let t=e.constructor,n;if(t.toJSON!==this.toJSON)n=t.toJSON(e);else{n={name:e.name,times:Bi(e.times,Array),values:Bi(e.values,Array)};let i=e.getInterpolation();i!==e.DefaultInterpolation&&(n.interpolation=i),Yr(e.settings)&&(n.settings={inTangents:Bi(e.settings.inTangents,Array),outTangents:Bi(e.settings.outTangents,Array)})}return n.type=e.ValueTypeName,n}InterpolantFactoryMethodDiscrete(e){return new qa(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodLinear(e){return new Xa(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodSmooth(e){return new Wa(this.times,this.values,this.getValueSize(),e)}InterpolantFactoryMethodBezier(e){let t=new $a(this.times,this.values,this.getValueSize(),e);return this.settings&&(t.inTangents=this.settings.inTangents,t.outTangents=this.settings.outTangents),t}setInterpolation(e){let t;switch(e){case us:t=this.InterpolantFactoryMethodDiscrete;break;case ds:t=this.InterpolantFactoryMethodLinear;break;case Ea:t=this.InterpolantFactoryMethodSmooth;break;case Uh:t=this.InterpolantFactoryMethodBezier;break}if(t===void 0){let n="unsupported interpolation for "+this.ValueTypeName+" keyframe track named "+this.name;if(this.createInterpolant===void 0)if(e!==this.DefaultInterpolation)this.setInterpolation(this.DefaultInterpolation);else throw new Error(n);return Ee("KeyframeTrack:",n),this}return this.createInterpolant=t,this}getInterpolation(){switch(this.createInterpolant){case this.InterpolantFactoryMethodDiscrete:return us;case this.InterpolantFactoryMethodLinear:return ds;case this.InterpolantFactoryMethodSmooth:return Ea;case this.InterpolantFactoryMethodBezier:return Uh}}getValueSize(){return this.values.length/this.times.length}shift(e){if(e!==0){let t=this.times;for(let n=0,i=t.length;n!==i;++n)t[n]+=e;Yr(this.settings)&&(Cf(this.settings.inTangents,e),Cf(this.settings.outTangents,e))}return this}scale(e){if(e!==1){let t=this.times;for(let n=0,i=t.length;n!==i;++n)t[n]*=e;Yr(this.settings)&&(Pf(this.settings.inTangents,e),Pf(this.settings.outTangents,e))}return this}trim(e,t){let n=this.times,i=n.length,r=0,o=i-1;for(;r!==i&&n[r]<e;)++r;for(;o!==-1&&n[o]>t;)--o;if(++o,r!==0||o!==i){r>=o&&(o=Math.max(o,1),r=o-1);let a=this.getValueSize();this.times=n.slice(r,o),this.values=this.values.slice(r*a,o*a)}return this}validate(){let e=!0,t=this.getValueSize();t-Math.floor(t)!==0&&(Oe("KeyframeTrack: Invalid value size in track.",this),e=!1);let n=this.times,i=this.values,r=n.length;r===0&&(Oe("KeyframeTrack: Track is empty.",this),e=!1);let o=null;for(let a=0;a!==r;a++){let l=n[a];if(typeof l=="number"&&isNaN(l)){Oe("KeyframeTrack: Time is not a valid number.",this,a,l),e=!1;break}if(o!==null&&o>l){Oe("KeyframeTrack: Out of order keys.",this,a,l,o),e=!1;break}o=l}if(i!==void 0&&l0(i))for(let a=0,l=i.length;a!==l;++a){let c=i[a];if(isNaN(c)){Oe("KeyframeTrack: Value is not a valid number.",this,a,c),e=!1;break}}return e}optimize(){let e=this.times.slice(),t=this.values.slice(),n=this.getValueSize(),i=this.getInterpolation()===Ea,r=e.length-1,o=1;for(let a=1;a<r;++a){let l=!1,c=e[a],h=e[a+1];if(c!==h&&(a!==1||c!==e[0]))if(i)l=!0;else{let u=a*n,d=u-n,f=u+n;for(let g=0;g!==n;++g){let y=t[u+g];if(y!==t[d+g]||y!==t[f+g]){l=!0;break}}}if(l){if(a!==o){e[o]=e[a];let u=a*n,d=o*n;for(let f=0;f!==n;++f)t[d+f]=t[u+f]}++o}}if(r>0){e[o]=e[r];for(let a=r*n,l=o*n,c=0;c!==n;++c)t[l+c]=t[a+c];++o}return o!==e.length?(this.times=e.slice(0,o),this.values=t.slice(0,o*n)):(this.times=e,this.values=t),this}clone(){let e=this.times.slice(),t=this.values.slice(),n=this.constructor,i=new n(this.name,e,t);return i.createInterpolant=this.createInterpolant,Yr(this.settings)&&(i.settings={inTangents:this.settings.inTangents.slice(),outTangents:this.settings.outTangents.slice()}),i}};function Cf(s,e){for(let t=0,n=s.length;t!==n;t+=2)s[t]+=e}function Pf(s,e){for(let t=0,n=s.length;t!==n;t+=2)s[t]*=e}fn.prototype.ValueTypeName="";fn.prototype.TimeBufferType=Float32Array;fn.prototype.ValueBufferType=Float32Array;fn.prototype.DefaultInterpolation=ds;var Mi=class extends fn{constructor(e,t,n){super(e,t,n)}};Mi.prototype.ValueTypeName="bool";Mi.prototype.ValueBufferType=Array;Mi.prototype.DefaultInterpolation=us;Mi.prototype.InterpolantFactoryMethodLinear=void 0;Mi.prototype.InterpolantFactoryMethodSmooth=void 0;var fo=class extends fn{constructor(e,t,n,i){super(e,t,n,i)}};fo.prototype.ValueTypeName="color";var wi=class extends fn{constructor(e,t,n,i){super(e,t,n,i)}};wi.prototype.ValueTypeName="number";var Ya=class extends Jn{constructor(e,t,n,i){super(e,t,n,i)}interpolate_(e,t,n,i){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,l=(n-t)/(i-t),c=e*a;for(let h=c+a;c!==h;c+=4)De.slerpFlat(r,0,o,c-a,o,c,l);return r}},Si=class extends fn{constructor(e,t,n,i){super(e,t,n,i)}InterpolantFactoryMethodLinear(e){return new Ya(this.times,this.values,this.getValueSize(),e)}};Si.prototype.ValueTypeName="quaternion";Si.prototype.InterpolantFactoryMethodSmooth=void 0;var Ti=class extends fn{constructor(e,t,n){super(e,t,n)}};Ti.prototype.ValueTypeName="string";Ti.prototype.ValueBufferType=Array;Ti.prototype.DefaultInterpolation=us;Ti.prototype.InterpolantFactoryMethodLinear=void 0;Ti.prototype.InterpolantFactoryMethodSmooth=void 0;var $i=class extends fn{constructor(e,t,n,i){super(e,t,n,i)}};$i.prototype.ValueTypeName="vector";var po=class{constructor(e="",t=-1,n=[],i=cp){this.name=e,this.tracks=n,this.duration=t,this.blendMode=i,this.uuid=ni(),this.userData={},this.duration<0&&this.resetDuration()}static parse(e){let t=[],n=e.tracks,i=1/(e.fps||1);for(let o=0,a=n.length;o!==a;++o)t.push(Q0(n[o]).scale(i));let r=new this(e.name,e.duration,t,e.blendMode);return r.uuid=e.uuid,r.userData=JSON.parse(e.userData||"{}"),r}static toJSON(e){let t=[],n=e.tracks,i={name:e.name,duration:e.duration,tracks:t,uuid:e.uuid,blendMode:e.blendMode,userData:JSON.stringify(e.userData)};for(let r=0,o=n.length;r!==o;++r)t.push(fn.toJSON(n[r]));return i}static CreateFromMorphTargetSequence(e,t,n,i){let r=t.length,o=[];for(let a=0;a<r;a++){let l=[],c=[];l.push((a+r-1)%r,a,(a+1)%r),c.push(0,1,0);let h=Y0(l);l=Rf(l,1,h),c=Rf(c,1,h),!i&&l[0]===0&&(l.push(r),c.push(c[0])),o.push(new wi(".morphTargetInfluences["+t[a].name+"]",l,c).scale(1/n))}return new this(e,-1,o)}static findByName(e,t){let n=e;if(!Array.isArray(e)){let i=e;n=i.geometry&&i.geometry.animations||i.animations}for(let i=0;i<n.length;i++)if(n[i].name===t)return n[i];return null}static CreateClipsFromMorphTargetSequences(e,t,n){let i={},r=/^([\w-]*?)([\d]+)$/;for(let a=0,l=e.length;a<l;a++){let c=e[a],h=c.name.match(r);if(h&&h.length>1){let u=h[1],d=i[u];d||(i[u]=d=[]),d.push(c)}}let o=[];for(let a in i)o.push(this.CreateFromMorphTargetSequence(a,i[a],t,n));return o}resetDuration(){let e=this.tracks,t=0;for(let n=0,i=e.length;n!==i;++n){let r=this.tracks[n];t=Math.max(t,r.times[r.times.length-1])}return this.duration=t,this}trim(){for(let e=0;e<this.tracks.length;e++)this.tracks[e].trim(0,this.duration);return this}validate(){let e=!0;for(let t=0;t<this.tracks.length;t++)e=e&&this.tracks[t].validate();return e}optimize(){for(let e=0;e<this.tracks.length;e++)this.tracks[e].optimize();return this}clone(){let e=[];for(let n=0;n<this.tracks.length;n++)e.push(this.tracks[n].clone());let t=new this.constructor(this.name,this.duration,e,this.blendMode);return t.userData=JSON.parse(JSON.stringify(this.userData)),t}toJSON(){return this.constructor.toJSON(this)}};function J0(s){switch(s.toLowerCase()){case"scalar":case"double":case"float":case"number":case"integer":return wi;case"vector":case"vector2":case"vector3":case"vector4":return $i;case"color":return fo;case"quaternion":return Si;case"bool":case"boolean":return Mi;case"string":return Ti}throw new Error("THREE.KeyframeTrack: Unsupported typeName: "+s)}function Q0(s){if(s.type===void 0)throw new Error("THREE.KeyframeTrack: track type undefined, can not parse");let e=J0(s.type);if(s.times===void 0){let n=[],i=[];K0(s.keys,n,i,"value"),s.times=n,s.values=i}let t;return e.parse!==void 0?t=e.parse(s):t=new e(s.name,s.times,s.values,s.interpolation),Yr(s.settings)&&(t.settings={inTangents:Bi(s.settings.inTangents,Float32Array),outTangents:Bi(s.settings.outTangents,Float32Array)}),t}var Kn={enabled:!1,files:{},add:function(s,e){this.enabled!==!1&&(If(s)||(this.files[s]=e))},get:function(s){if(this.enabled!==!1&&!If(s))return this.files[s]},remove:function(s){delete this.files[s]},clear:function(){this.files={}}};function If(s){try{let e=s.slice(s.indexOf(":")+1);return new URL(e).protocol==="blob:"}catch{return!1}}var Ka=class{constructor(e,t,n){let i=this,r=!1,o=0,a=0,l,c=[];this.onStart=void 0,this.onLoad=e,this.onProgress=t,this.onError=n,this._abortController=null,this.itemStart=function(h){a++,r===!1&&i.onStart!==void 0&&i.onStart(h,o,a),r=!0},this.itemEnd=function(h){o++,i.onProgress!==void 0&&i.onProgress(h,o,a),o===a&&(r=!1,i.onLoad!==void 0&&i.onLoad())},this.itemError=function(h){i.onError!==void 0&&i.onError(h)},this.resolveURL=function(h){return h=h.normalize("NFC"),l?l(h):h},this.setURLModifier=function(h){return l=h,this},this.addHandler=function(h,u){return c.push(h,u),this},this.removeHandler=function(h){let u=c.indexOf(h);return u!==-1&&c.splice(u,2),this},this.getHandler=function(h){for(let u=0,d=c.length;u<d;u+=2){let f=c[u],g=c[u+1];if(f.global&&(f.lastIndex=0),f.test(h))return g}return null},this.abort=function(){return this.abortController.abort(),this._abortController=null,this}}get abortController(){return this._abortController||(this._abortController=new AbortController),this._abortController}},Ap=new Ka,Qn=class{constructor(e){this.manager=e!==void 0?e:Ap,this.crossOrigin="anonymous",this.withCredentials=!1,this.path="",this.resourcePath="",this.requestHeader={},this.priority="auto",this.cache="default",typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}load(){}loadAsync(e,t){let n=this;return new Promise(function(i,r){n.load(e,i,t,r)})}parse(){}setCrossOrigin(e){return this.crossOrigin=e,this}setWithCredentials(e){return this.withCredentials=e,this}setPath(e){return this.path=e,this}setResourcePath(e){return this.resourcePath=e,this}setRequestHeader(e){return this.requestHeader=e,this}setPriority(e){return this.priority=e,this}setCache(e){return this.cache=e,this}abort(){return this}};Qn.DEFAULT_MATERIAL_NAME="__DEFAULT";var mi={},Hh=class extends Error{constructor(e,t){super(e),this.response=t}},pr=class extends Qn{constructor(e){super(e),this.mimeType="",this.responseType="",this._abortController=new AbortController}load(e,t,n,i){e===void 0&&(e=""),this.path!==void 0&&(e=this.path+e),e=this.manager.resolveURL(e);let r=Kn.get(`file:${e}`);if(r!==void 0){this.manager.itemStart(e),setTimeout(()=>{t&&t(r),this.manager.itemEnd(e)},0);return}if(mi[e]!==void 0){mi[e].push({onLoad:t,onProgress:n,onError:i});return}mi[e]=[],mi[e].push({onLoad:t,onProgress:n,onError:i});let o=new Request(e,{headers:new Headers(this.requestHeader),credentials:this.withCredentials?"include":"same-origin",priority:this.priority,cache:this.cache,signal:typeof AbortSignal.any=="function"?AbortSignal.any([this._abortController.signal,this.manager.abortController.signal]):this._abortController.signal}),a=this.mimeType,l=this.responseType;fetch(o).then(c=>{if(c.status===200||c.status===0){if(c.status===0&&Ee("FileLoader: HTTP Status 0 received."),typeof ReadableStream>"u"||c.body===void 0||c.body.getReader===void 0)return c;let h=mi[e],u=c.body.getReader(),d=c.headers.get("X-File-Size")||c.headers.get("Content-Length"),f=d?parseInt(d):0,g=f!==0,y=0,p=new ReadableStream({start(m){b();function b(){u.read().then(({done:E,value:M})=>{if(E)m.close();else{y+=M.byteLength;let R=new ProgressEvent("progress",{lengthComputable:g,loaded:y,total:f});for(let T=0,x=h.length;T<x;T++){let w=h[T];w.onProgress&&w.onProgress(R)}m.enqueue(M),b()}},E=>{m.error(E)})}}});return new Response(p)}else throw new Hh(`fetch for "${c.url}" responded with ${c.status}: ${c.statusText}`,c)}).then(c=>{switch(l){case"arraybuffer":return c.arrayBuffer();case"blob":return c.blob();case"document":return c.text().then(h=>new DOMParser().parseFromString(h,a));case"json":return c.json();default:if(a==="")return c.text();{let u=/charset="?([^;"\s]*)"?/i.exec(a),d=u&&u[1]?u[1].toLowerCase():void 0,f=new TextDecoder(d);return c.arrayBuffer().then(g=>f.decode(g))}}}).then(c=>{Kn.add(`file:${e}`,c);let h=mi[e];delete mi[e];for(let u=0,d=h.length;u<d;u++){let f=h[u];f.onLoad&&f.onLoad(c)}}).catch(c=>{let h=mi[e];if(h===void 0)throw this.manager.itemError(e),c;delete mi[e];for(let u=0,d=h.length;u<d;u++){let f=h[u];f.onError&&f.onError(c)}this.manager.itemError(e)}).finally(()=>{this.manager.itemEnd(e)}),this.manager.itemStart(e)}setResponseType(e){return this.responseType=e,this}setMimeType(e){return this.mimeType=e,this}abort(){return this._abortController.abort(),this._abortController=new AbortController,this}};var Zs=new WeakMap,ja=class extends Qn{constructor(e){super(e)}load(e,t,n,i){this.path!==void 0&&(e=this.path+e),e=this.manager.resolveURL(e);let r=this,o=Kn.get(`image:${e}`);if(o!==void 0){if(o.complete===!0)r.manager.itemStart(e),setTimeout(function(){t&&t(o),r.manager.itemEnd(e)},0);else{let u=Zs.get(o);u===void 0&&(u=[],Zs.set(o,u)),u.push({onLoad:t,onError:i})}return o}let a=rr("img");function l(){h(),t&&t(this);let u=Zs.get(this)||[];for(let d=0;d<u.length;d++){let f=u[d];f.onLoad&&f.onLoad(this)}Zs.delete(this),r.manager.itemEnd(e)}function c(u){h(),i&&i(u),Kn.remove(`image:${e}`);let d=Zs.get(this)||[];for(let f=0;f<d.length;f++){let g=d[f];g.onError&&g.onError(u)}Zs.delete(this),r.manager.itemError(e),r.manager.itemEnd(e)}function h(){a.removeEventListener("load",l,!1),a.removeEventListener("error",c,!1)}return a.addEventListener("load",l,!1),a.addEventListener("error",c,!1),e.slice(0,5)!=="data:"&&this.crossOrigin!==void 0&&(a.crossOrigin=this.crossOrigin),Kn.add(`image:${e}`,a),r.manager.itemStart(e),a.fetchPriority=this.priority,a.src=e,a}};var mo=class extends Qn{constructor(e){super(e)}load(e,t,n,i){let r=new Nt,o=new ja(this.manager);return o.setPriority(this.priority),o.setCache(this.cache),o.setCrossOrigin(this.crossOrigin),o.setPath(this.path),o.load(e,function(a){r.image=a,r.needsUpdate=!0,t!==void 0&&t(r)},n,i),r}},Yi=class extends it{static registerNode(e){this.prototype._lightNode=e}constructor(e,t=1){super(),this.isLight=!0,this.type="Light",this.color=new ve(e),this.intensity=t}copy(e,t){return super.copy(e,t),this.color.copy(e.color),this.intensity=e.intensity,this}toJSON(e){let t=super.toJSON(e);return t.object.color=this.color.getHex(),t.object.intensity=this.intensity,t}},go=class extends Yi{constructor(e,t,n){super(e,n),this.isHemisphereLight=!0,this.type="HemisphereLight",this.position.copy(it.DEFAULT_UP),this.updateMatrix(),this.groundColor=new ve(t)}copy(e,t){return super.copy(e,t),this.groundColor.copy(e.groundColor),this}toJSON(e){let t=super.toJSON(e);return t.object.groundColor=this.groundColor.getHex(),t}},Lh=new _e,Lf=new S,Df=new S,mr=class{constructor(e){this.camera=e,this.intensity=1,this.bias=0,this.biasNode=null,this.normalBias=0,this.radius=1,this.blurSamples=8,this.mapSize=new ye(512,512),this.mapType=pn,this.map=null,this.mapPass=null,this.matrix=new _e,this.autoUpdate=!0,this.needsUpdate=!1,this._frustum=new Vi,this._frameExtents=new ye(1,1),this._viewportCount=1,this._viewports=[new at(0,0,1,1)]}getViewportCount(){return this._viewportCount}getCamera(){return this.camera}getFrustum(){return this._frustum}updateMatrices(e){let t=this.camera;Lf.setFromMatrixPosition(e.matrixWorld),t.position.copy(Lf),Df.setFromMatrixPosition(e.target.matrixWorld),t.lookAt(Df),t.updateMatrixWorld(),this._updateMatrix(t,this.matrix,this._frustum)}_updateMatrix(e,t,n,i){Lh.multiplyMatrices(e.projectionMatrix,e.matrixWorldInverse),n.setFromProjectionMatrix(Lh,e.coordinateSystem,e.reversedDepth);let r=this._frameExtents,o=i?i.z/r.x:1,a=i?i.w/r.y:1,l=i?i.x/r.x:0,c=i?i.y/r.y:0;e.coordinateSystem===sr||e.reversedDepth?t.set(.5*o,0,0,.5*o+l,0,.5*a,0,.5*a+c,0,0,1,0,0,0,0,1):t.set(.5*o,0,0,.5*o+l,0,.5*a,0,.5*a+c,0,0,.5,.5,0,0,0,1),t.multiply(Lh)}getViewport(e){return this._viewports[e]}getFrameExtents(){return this._frameExtents}dispose(){this.map&&this.map.dispose(),this.mapPass&&this.mapPass.dispose()}copy(e){return this.camera=e.camera.clone(),this.intensity=e.intensity,this.bias=e.bias,this.radius=e.radius,this.autoUpdate=e.autoUpdate,this.needsUpdate=e.needsUpdate,this.normalBias=e.normalBias,this.blurSamples=e.blurSamples,this.mapSize.copy(e.mapSize),this.mapType=e.mapType,this.biasNode=e.biasNode,this}clone(){return new this.constructor().copy(this)}toJSON(){let e={};return e.intensity=this.intensity,e.bias=this.bias,e.normalBias=this.normalBias,e.radius=this.radius,e.blurSamples=this.blurSamples,e.mapSize=this.mapSize.toArray(),e.mapType=this.mapType,e.camera=this.camera.toJSON(!1).object,delete e.camera.matrix,e}},Sa=new S,Ta=new De,$n=new S,xo=class extends it{constructor(){super(),this.isCamera=!0,this.type="Camera",this.matrixWorldInverse=new _e,this.projectionMatrix=new _e,this.projectionMatrixInverse=new _e,this.coordinateSystem=Pn,this._reversedDepth=!1}get reversedDepth(){return this._reversedDepth}copy(e,t){return super.copy(e,t),this.matrixWorldInverse.copy(e.matrixWorldInverse),this.projectionMatrix.copy(e.projectionMatrix),this.projectionMatrixInverse.copy(e.projectionMatrixInverse),this.coordinateSystem=e.coordinateSystem,this}getWorldDirection(e){return super.getWorldDirection(e).negate()}updateMatrixWorld(e){super.updateMatrixWorld(e),this.matrixWorld.decompose(Sa,Ta,$n),$n.x===1&&$n.y===1&&$n.z===1?this.matrixWorldInverse.copy(this.matrixWorld).invert():this.matrixWorldInverse.compose(Sa,Ta,$n.set(1,1,1)).invert()}updateWorldMatrix(e,t,n=!1){super.updateWorldMatrix(e,t,n),this.matrixWorld.decompose(Sa,Ta,$n),$n.x===1&&$n.y===1&&$n.z===1?this.matrixWorldInverse.copy(this.matrixWorld).invert():this.matrixWorldInverse.compose(Sa,Ta,$n.set(1,1,1)).invert()}clone(){return new this.constructor().copy(this)}},ki=new S,Nf=new ye,Of=new ye,dt=class extends xo{constructor(e=50,t=1,n=.1,i=2e3){super(),this.isPerspectiveCamera=!0,this.type="PerspectiveCamera",this.fov=e,this.zoom=1,this.near=n,this.far=i,this.focus=10,this.aspect=t,this.view=null,this.filmGauge=35,this.filmOffset=0,this.updateProjectionMatrix()}copy(e,t){return super.copy(e,t),this.fov=e.fov,this.zoom=e.zoom,this.near=e.near,this.far=e.far,this.focus=e.focus,this.aspect=e.aspect,this.view=e.view===null?null:Object.assign({},e.view),this.filmGauge=e.filmGauge,this.filmOffset=e.filmOffset,this}setFocalLength(e){let t=.5*this.getFilmHeight()/e;this.fov=fs*2*Math.atan(t),this.updateProjectionMatrix()}getFocalLength(){let e=Math.tan(er*.5*this.fov);return .5*this.getFilmHeight()/e}getEffectiveFOV(){return fs*2*Math.atan(Math.tan(er*.5*this.fov)/this.zoom)}getFilmWidth(){return this.filmGauge*Math.min(this.aspect,1)}getFilmHeight(){return this.filmGauge/Math.max(this.aspect,1)}getViewBounds(e,t,n){ki.set(-1,-1,.5).applyMatrix4(this.projectionMatrixInverse),t.set(ki.x,ki.y).multiplyScalar(-e/ki.z),ki.set(1,1,.5).applyMatrix4(this.projectionMatrixInverse),n.set(ki.x,ki.y).multiplyScalar(-e/ki.z)}getViewSize(e,t){return this.getViewBounds(e,Nf,Of),t.subVectors(Of,Nf)}setViewOffset(e,t,n,i,r,o){this.aspect=e/t,this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=e,this.view.fullHeight=t,this.view.offsetX=n,this.view.offsetY=i,this.view.width=r,this.view.height=o,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let e=this.near,t=e*Math.tan(er*.5*this.fov)/this.zoom,n=2*t,i=this.aspect*n,r=-.5*i,o=this.view;if(this.view!==null&&this.view.enabled){let l=o.fullWidth,c=o.fullHeight;r+=o.offsetX*i/l,t-=o.offsetY*n/c,i*=o.width/l,n*=o.height/c}let a=this.filmOffset;a!==0&&(r+=e*a/this.getFilmWidth()),this.projectionMatrix.makePerspective(r,r+i,t,t-n,e,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(e){let t=super.toJSON(e);return t.object.fov=this.fov,t.object.zoom=this.zoom,t.object.near=this.near,t.object.far=this.far,t.object.focus=this.focus,t.object.aspect=this.aspect,this.view!==null&&(t.object.view=Object.assign({},this.view)),t.object.filmGauge=this.filmGauge,t.object.filmOffset=this.filmOffset,t}},Gh=class extends mr{constructor(){super(new dt(50,1,.5,500)),this.isSpotLightShadow=!0,this.focus=1,this.aspect=1}updateMatrices(e){let t=this.camera,n=fs*2*e.angle*this.focus,i=this.mapSize.width/this.mapSize.height*this.aspect,r=e.distance||t.far;(n!==t.fov||i!==t.aspect||r!==t.far)&&(t.fov=n,t.aspect=i,t.far=r,t.updateProjectionMatrix()),super.updateMatrices(e)}copy(e){return super.copy(e),this.focus=e.focus,this.aspect=e.aspect,this}toJSON(){let e=super.toJSON();return e.focus=this.focus,e.aspect=this.aspect,e}},xs=class extends Yi{constructor(e,t,n=0,i=Math.PI/3,r=0,o=2){super(e,t),this.isSpotLight=!0,this.type="SpotLight",this.position.copy(it.DEFAULT_UP),this.updateMatrix(),this.target=new it,this.distance=n,this.angle=i,this.penumbra=r,this.decay=o,this.map=null,this.shadow=new Gh}get power(){return this.intensity*Math.PI}set power(e){this.intensity=e/Math.PI}dispose(){super.dispose(),this.shadow.dispose()}copy(e,t){return super.copy(e,t),this.distance=e.distance,this.angle=e.angle,this.penumbra=e.penumbra,this.decay=e.decay,this.target=e.target.clone(),this.map=e.map,this.shadow=e.shadow.clone(),this}toJSON(e){let t=super.toJSON(e);return t.object.distance=this.distance,t.object.angle=this.angle,t.object.decay=this.decay,t.object.penumbra=this.penumbra,t.object.target=this.target.uuid,this.map&&this.map.isTexture&&(t.object.map=this.map.toJSON(e).uuid),t.object.shadow=this.shadow.toJSON(),t}},Vh=class extends mr{constructor(){super(new dt(90,1,.5,500)),this.isPointLightShadow=!0}},ys=class extends Yi{constructor(e,t,n=0,i=2){super(e,t),this.isPointLight=!0,this.type="PointLight",this.distance=n,this.decay=i,this.shadow=new Vh}get power(){return this.intensity*4*Math.PI}set power(e){this.intensity=e/(4*Math.PI)}dispose(){super.dispose(),this.shadow.dispose()}copy(e,t){return super.copy(e,t),this.distance=e.distance,this.decay=e.decay,this.shadow=e.shadow.clone(),this}toJSON(e){let t=super.toJSON(e);return t.object.distance=this.distance,t.object.decay=this.decay,t.object.shadow=this.shadow.toJSON(),t}},Gn=class extends xo{constructor(e=-1,t=1,n=1,i=-1,r=.1,o=2e3){super(),this.isOrthographicCamera=!0,this.type="OrthographicCamera",this.zoom=1,this.view=null,this.left=e,this.right=t,this.top=n,this.bottom=i,this.near=r,this.far=o,this.updateProjectionMatrix()}copy(e,t){return super.copy(e,t),this.left=e.left,this.right=e.right,this.top=e.top,this.bottom=e.bottom,this.near=e.near,this.far=e.far,this.zoom=e.zoom,this.view=e.view===null?null:Object.assign({},e.view),this}setViewOffset(e,t,n,i,r,o){this.view===null&&(this.view={enabled:!0,fullWidth:1,fullHeight:1,offsetX:0,offsetY:0,width:1,height:1}),this.view.enabled=!0,this.view.fullWidth=e,this.view.fullHeight=t,this.view.offsetX=n,this.view.offsetY=i,this.view.width=r,this.view.height=o,this.updateProjectionMatrix()}clearViewOffset(){this.view!==null&&(this.view.enabled=!1),this.updateProjectionMatrix()}updateProjectionMatrix(){let e=(this.right-this.left)/(2*this.zoom),t=(this.top-this.bottom)/(2*this.zoom),n=(this.right+this.left)/2,i=(this.top+this.bottom)/2,r=n-e,o=n+e,a=i+t,l=i-t;if(this.view!==null&&this.view.enabled){let c=(this.right-this.left)/this.view.fullWidth/this.zoom,h=(this.top-this.bottom)/this.view.fullHeight/this.zoom;r+=c*this.view.offsetX,o=r+c*this.view.width,a-=h*this.view.offsetY,l=a-h*this.view.height}this.projectionMatrix.makeOrthographic(r,o,a,l,this.near,this.far,this.coordinateSystem,this.reversedDepth),this.projectionMatrixInverse.copy(this.projectionMatrix).invert()}toJSON(e){let t=super.toJSON(e);return t.object.zoom=this.zoom,t.object.left=this.left,t.object.right=this.right,t.object.top=this.top,t.object.bottom=this.bottom,t.object.near=this.near,t.object.far=this.far,this.view!==null&&(t.object.view=Object.assign({},this.view)),t}},Wh=class extends mr{constructor(){super(new Gn(-5,5,5,-5,.5,500)),this.isDirectionalLightShadow=!0}},Ki=class extends Yi{constructor(e,t){super(e,t),this.isDirectionalLight=!0,this.type="DirectionalLight",this.position.copy(it.DEFAULT_UP),this.updateMatrix(),this.target=new it,this.shadow=new Wh}dispose(){super.dispose(),this.shadow.dispose()}copy(e){return super.copy(e),this.target=e.target.clone(),this.shadow=e.shadow.clone(),this}toJSON(e){let t=super.toJSON(e);return t.object.shadow=this.shadow.toJSON(),t.object.target=this.target.uuid,t}},vs=class extends Yi{constructor(e,t){super(e,t),this.isAmbientLight=!0,this.type="AmbientLight"}};var Ai=class{static extractUrlBase(e){let t=e.lastIndexOf("/");return t===-1?"./":e.slice(0,t+1)}static resolveURL(e,t){return typeof e!="string"||e===""?"":(/^https?:\/\//i.test(t)&&/^\//.test(e)&&(t=t.replace(/(^https?:\/\/[^\/]+).*/i,"$1")),/^(https?:)?\/\//i.test(e)||/^data:.*,.*$/i.test(e)||/^blob:.*$/i.test(e)?e:t+e)}};var Dh=new WeakMap,yo=class extends Qn{constructor(e){super(e),this.isImageBitmapLoader=!0,typeof createImageBitmap>"u"&&Ee("ImageBitmapLoader: createImageBitmap() not supported."),typeof fetch>"u"&&Ee("ImageBitmapLoader: fetch() not supported."),this.options={premultiplyAlpha:"none"},this._abortController=new AbortController}setOptions(e){return this.options=e,this}load(e,t,n,i){e===void 0&&(e=""),this.path!==void 0&&(e=this.path+e),e=this.manager.resolveURL(e);let r=this,o=Kn.get(`image-bitmap:${e}`);if(o!==void 0){if(r.manager.itemStart(e),o.then){o.then(c=>{Dh.has(o)===!0?(i&&i(Dh.get(o)),r.manager.itemError(e),r.manager.itemEnd(e)):(t&&t(c),r.manager.itemEnd(e))});return}setTimeout(function(){t&&t(o),r.manager.itemEnd(e)},0);return}let a={};a.credentials=this.withCredentials||this.crossOrigin!=="anonymous"?"include":"same-origin",a.headers=this.requestHeader,a.priority=this.priority,a.cache=this.cache,a.signal=typeof AbortSignal.any=="function"?AbortSignal.any([this._abortController.signal,this.manager.abortController.signal]):this._abortController.signal;let l=fetch(e,a).then(function(c){return c.blob()}).then(function(c){return createImageBitmap(c,Object.assign({},r.options,{colorSpaceConversion:"none"}))}).then(function(c){return Kn.add(`image-bitmap:${e}`,c),t&&t(c),r.manager.itemEnd(e),c}).catch(function(c){i&&i(c),Dh.set(l,c),Kn.remove(`image-bitmap:${e}`),r.manager.itemError(e),r.manager.itemEnd(e)});Kn.add(`image-bitmap:${e}`,l),r.manager.itemStart(e)}abort(){return this._abortController.abort(),this._abortController=new AbortController,this}};var Js=-90,Qs=1,gr=class extends it{constructor(e,t,n){super(),this.type="CubeCamera",this.renderTarget=n,this.coordinateSystem=null,this.activeMipmapLevel=0;let i=new dt(Js,Qs,e,t);i.layers=this.layers,this.add(i);let r=new dt(Js,Qs,e,t);r.layers=this.layers,this.add(r);let o=new dt(Js,Qs,e,t);o.layers=this.layers,this.add(o);let a=new dt(Js,Qs,e,t);a.layers=this.layers,this.add(a);let l=new dt(Js,Qs,e,t);l.layers=this.layers,this.add(l);let c=new dt(Js,Qs,e,t);c.layers=this.layers,this.add(c)}updateCoordinateSystem(){let e=this.coordinateSystem,t=this.children.concat(),[n,i,r,o,a,l]=t;for(let c of t)this.remove(c);if(e===Pn)n.up.set(0,1,0),n.lookAt(1,0,0),i.up.set(0,1,0),i.lookAt(-1,0,0),r.up.set(0,0,-1),r.lookAt(0,1,0),o.up.set(0,0,1),o.lookAt(0,-1,0),a.up.set(0,1,0),a.lookAt(0,0,1),l.up.set(0,1,0),l.lookAt(0,0,-1);else if(e===sr)n.up.set(0,-1,0),n.lookAt(-1,0,0),i.up.set(0,-1,0),i.lookAt(1,0,0),r.up.set(0,0,1),r.lookAt(0,1,0),o.up.set(0,0,-1),o.lookAt(0,-1,0),a.up.set(0,-1,0),a.lookAt(0,0,1),l.up.set(0,-1,0),l.lookAt(0,0,-1);else throw new Error("THREE.CubeCamera.updateCoordinateSystem(): Invalid coordinate system: "+e);for(let c of t)this.add(c),c.updateMatrixWorld()}update(e,t){this.parent===null&&this.updateMatrixWorld();let{renderTarget:n,activeMipmapLevel:i}=this;this.coordinateSystem!==e.coordinateSystem&&(this.coordinateSystem=e.coordinateSystem,this.updateCoordinateSystem());let[r,o,a,l,c,h]=this.children,u=e.getRenderTarget(),d=e.getActiveCubeFace(),f=e.getActiveMipmapLevel(),g=e.xr.enabled;e.xr.enabled=!1;let y=n.texture.mipmapsAutoUpdate;n.texture.mipmapsAutoUpdate=!1;let p=!1;e.isWebGLRenderer===!0?p=e.state.buffers.depth.getReversed():p=e.reversedDepthBuffer,e.setRenderTarget(n,0,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,r),e.setRenderTarget(n,1,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,o),e.setRenderTarget(n,2,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,a),e.setRenderTarget(n,3,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,l),e.setRenderTarget(n,4,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,c),n.texture.mipmapsAutoUpdate=y,e.setRenderTarget(n,5,i),p&&e.autoClear===!1&&e.clearDepth(),e.render(t,h),e.setRenderTarget(u,d,f),e.xr.enabled=g,n.texture.needsPMREMUpdate=!0}},Za=class extends dt{constructor(e=[]){super(),this.isArrayCamera=!0,this.isMultiViewCamera=!1,this.cameras=e,this.perCameraFrustumCulled=!1}};var Su="\\[\\]\\.:\\/",ex=new RegExp("["+Su+"]","g"),Tu="[^"+Su+"]",tx="[^"+Su.replace("\\.","")+"]",nx=/((?:WC+[\/:])*)/.source.replace("WC",Tu),ix=/(WCOD+)?/.source.replace("WCOD",tx),sx=/(?:\.(WC+)(?:\[(.+)\])?)?/.source.replace("WC",Tu),rx=/\.(WC+)(?:\[(.+)\])?/.source.replace("WC",Tu),ox=new RegExp("^"+nx+ix+sx+rx+"$"),ax=["material","materials","bones","map"],Xh=class{constructor(e,t,n){let i=n||ut.parseTrackName(t);this._targetGroup=e,this._bindings=e.subscribe_(t,i)}getValue(e,t){this.bind();let n=this._targetGroup.nCachedObjects_,i=this._bindings[n];i!==void 0&&i.getValue(e,t)}setValue(e,t){let n=this._bindings;for(let i=this._targetGroup.nCachedObjects_,r=n.length;i!==r;++i)n[i].setValue(e,t)}bind(){let e=this._bindings;for(let t=this._targetGroup.nCachedObjects_,n=e.length;t!==n;++t)e[t].bind()}unbind(){let e=this._bindings;for(let t=this._targetGroup.nCachedObjects_,n=e.length;t!==n;++t)e[t].unbind()}},ut=class s{constructor(e,t,n){this.path=t,this.parsedPath=n||s.parseTrackName(t),this.node=s.findNode(e,this.parsedPath.nodeName),this.rootNode=e,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}static create(e,t,n){return e&&e.isAnimationObjectGroup?new s.Composite(e,t,n):new s(e,t,n)}static sanitizeNodeName(e){return e.replace(/\s/g,"_").replace(ex,"")}static parseTrackName(e){let t=ox.exec(e);if(t===null)throw new Error("THREE.PropertyBinding: Cannot parse trackName: "+e);let n={nodeName:t[2],objectName:t[3],objectIndex:t[4],propertyName:t[5],propertyIndex:t[6]},i=n.nodeName&&n.nodeName.lastIndexOf(".");if(i!==void 0&&i!==-1){let r=n.nodeName.substring(i+1);ax.indexOf(r)!==-1&&(n.nodeName=n.nodeName.substring(0,i),n.objectName=r)}if(n.propertyName===null||n.propertyName.length===0)throw new Error("THREE.PropertyBinding: can not parse propertyName from trackName: "+e);return n}static findNode(e,t){if(t===void 0||t===""||t==="."||t===-1||t===e.name||t===e.uuid)return e;if(e.skeleton){let n=e.skeleton.getBoneByName(t);if(n!==void 0)return n}if(e.children){let n=function(r){for(let o=0;o<r.length;o++){let a=r[o];if(a.name===t||a.uuid===t)return a;let l=n(a.children);if(l)return l}return null},i=n(e.children);if(i)return i}return null}_getValue_unavailable(){}_setValue_unavailable(){}_getValue_direct(e,t){e[t]=this.targetObject[this.propertyName]}_getValue_array(e,t){let n=this.resolvedProperty;for(let i=0,r=n.length;i!==r;++i)e[t++]=n[i]}_getValue_arrayElement(e,t){e[t]=this.resolvedProperty[this.propertyIndex]}_getValue_toArray(e,t){this.resolvedProperty.toArray(e,t)}_setValue_direct(e,t){this.targetObject[this.propertyName]=e[t]}_setValue_direct_setNeedsUpdate(e,t){this.targetObject[this.propertyName]=e[t],this.targetObject.needsUpdate=!0}_setValue_direct_setMatrixWorldNeedsUpdate(e,t){this.targetObject[this.propertyName]=e[t],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_array(e,t){let n=this.resolvedProperty;for(let i=0,r=n.length;i!==r;++i)n[i]=e[t++]}_setValue_array_setNeedsUpdate(e,t){let n=this.resolvedProperty;for(let i=0,r=n.length;i!==r;++i)n[i]=e[t++];this.targetObject.needsUpdate=!0}_setValue_array_setMatrixWorldNeedsUpdate(e,t){let n=this.resolvedProperty;for(let i=0,r=n.length;i!==r;++i)n[i]=e[t++];this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_arrayElement(e,t){this.resolvedProperty[this.propertyIndex]=e[t]}_setValue_arrayElement_setNeedsUpdate(e,t){this.resolvedProperty[this.propertyIndex]=e[t],this.targetObject.needsUpdate=!0}_setValue_arrayElement_setMatrixWorldNeedsUpdate(e,t){this.resolvedProperty[this.propertyIndex]=e[t],this.targetObject.matrixWorldNeedsUpdate=!0}_setValue_fromArray(e,t){this.resolvedProperty.fromArray(e,t)}_setValue_fromArray_setNeedsUpdate(e,t){this.resolvedProperty.fromArray(e,t),this.targetObject.needsUpdate=!0}_setValue_fromArray_setMatrixWorldNeedsUpdate(e,t){this.resolvedProperty.fromArray(e,t),this.targetObject.matrixWorldNeedsUpdate=!0}_getValue_unbound(e,t){this.bind(),this.getValue(e,t)}_setValue_unbound(e,t){this.bind(),this.setValue(e,t)}bind(){let e=this.node,t=this.parsedPath,n=t.objectName,i=t.propertyName,r=t.propertyIndex;if(e||(e=s.findNode(this.rootNode,t.nodeName),this.node=e),this.getValue=this._getValue_unavailable,this.setValue=this._setValue_unavailable,!e){Ee("PropertyBinding: No target node found for track: "+this.path+".");return}if(n){let c=t.objectIndex;switch(n){case"materials":if(!e.material){Oe("PropertyBinding: Can not bind to material as node does not have a material.",this);return}if(!e.material.materials){Oe("PropertyBinding: Can not bind to material.materials as node.material does not have a materials array.",this);return}e=e.material.materials;break;case"bones":if(!e.skeleton){Oe("PropertyBinding: Can not bind to bones as node does not have a skeleton.",this);return}e=e.skeleton.bones;for(let h=0;h<e.length;h++)if(e[h].name===c){c=h;break}break;case"map":if("map"in e){e=e.map;break}if(!e.material){Oe("PropertyBinding: Can not bind to material as node does not have a material.",this);return}if(!e.material.map){Oe("PropertyBinding: Can not bind to material.map as node.material does not have a map.",this);return}e=e.material.map;break;default:if(e[n]===void 0){Oe("PropertyBinding: Can not bind to objectName of node undefined.",this);return}e=e[n]}if(c!==void 0){if(e[c]===void 0){Oe("PropertyBinding: Trying to bind to objectIndex of objectName, but is undefined.",this,e);return}e=e[c]}}let o=e[i];if(o===void 0){let c=t.nodeName;Oe("PropertyBinding: Trying to update property for track: "+c+"."+i+" but it wasn't found.",e);return}let a=this.Versioning.None;this.targetObject=e,e.isMaterial===!0?a=this.Versioning.NeedsUpdate:e.isObject3D===!0&&(a=this.Versioning.MatrixWorldNeedsUpdate);let l=this.BindingType.Direct;if(r!==void 0){if(i==="morphTargetInfluences"){if(!e.geometry){Oe("PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.",this);return}if(!e.geometry.morphAttributes){Oe("PropertyBinding: Can not bind to morphTargetInfluences because node does not have a geometry.morphAttributes.",this);return}e.morphTargetDictionary[r]!==void 0&&(r=e.morphTargetDictionary[r])}l=this.BindingType.ArrayElement,this.resolvedProperty=o,this.propertyIndex=r}else o.fromArray!==void 0&&o.toArray!==void 0?(l=this.BindingType.HasFromToArray,this.resolvedProperty=o):Array.isArray(o)?(l=this.BindingType.EntireArray,this.resolvedProperty=o):this.propertyName=i;this.getValue=this.GetterByBindingType[l],this.setValue=this.SetterByBindingTypeAndVersioning[l][a]}unbind(){this.node=null,this.getValue=this._getValue_unbound,this.setValue=this._setValue_unbound}};ut.Composite=Xh;ut.prototype.BindingType={Direct:0,EntireArray:1,ArrayElement:2,HasFromToArray:3};ut.prototype.Versioning={None:0,NeedsUpdate:1,MatrixWorldNeedsUpdate:2};ut.prototype.GetterByBindingType=[ut.prototype._getValue_direct,ut.prototype._getValue_array,ut.prototype._getValue_arrayElement,ut.prototype._getValue_toArray];ut.prototype.SetterByBindingTypeAndVersioning=[[ut.prototype._setValue_direct,ut.prototype._setValue_direct_setNeedsUpdate,ut.prototype._setValue_direct_setMatrixWorldNeedsUpdate],[ut.prototype._setValue_array,ut.prototype._setValue_array_setNeedsUpdate,ut.prototype._setValue_array_setMatrixWorldNeedsUpdate],[ut.prototype._setValue_arrayElement,ut.prototype._setValue_arrayElement_setNeedsUpdate,ut.prototype._setValue_arrayElement_setMatrixWorldNeedsUpdate],[ut.prototype._setValue_fromArray,ut.prototype._setValue_fromArray_setNeedsUpdate,ut.prototype._setValue_fromArray_setMatrixWorldNeedsUpdate]];var UT=new Float32Array(1);var Uf=new _e,_s=class{constructor(e,t,n=0,i=1/0){this.ray=new Zn(e,t),this.near=n,this.far=i,this.camera=null,this.layers=new lr,this.params={Mesh:{},Line:{threshold:1},LOD:{},Points:{threshold:1},Sprite:{}}}set(e,t){this.ray.set(e,t)}setFromCamera(e,t){t.isPerspectiveCamera?(this.ray.origin.setFromMatrixPosition(t.matrixWorld),this.ray.direction.set(e.x,e.y,.5).unproject(t).sub(this.ray.origin).normalize(),this.camera=t):t.isOrthographicCamera?(this.ray.origin.set(e.x,e.y,t.projectionMatrix.elements[14]).unproject(t),this.ray.direction.set(0,0,-1).transformDirection(t.matrixWorld),this.camera=t):Oe("Raycaster: Unsupported camera type: "+t.type)}setFromXRController(e){return Uf.identity().extractRotation(e.matrixWorld),this.ray.origin.setFromMatrixPosition(e.matrixWorld),this.ray.direction.set(0,0,-1).applyMatrix4(Uf),this}intersectObject(e,t=!0,n=[]){return qh(e,this,n,t),n.sort(Ff),n}intersectObjects(e,t=!0,n=[]){for(let i=0,r=e.length;i<r;i++)qh(e[i],this,n,t);return n.sort(Ff),n}};function Ff(s,e){return s.distance-e.distance}function qh(s,e,t,n){let i=!0;if(s.layers.test(e.layers)&&s.raycast(e,t)===!1&&(i=!1),i===!0&&n===!0){let r=s.children;for(let o=0,a=r.length;o<a;o++)qh(r[o],e,t,!0)}}var xr=class{constructor(e=1,t=0,n=0){this.radius=e,this.phi=t,this.theta=n}set(e,t,n){return this.radius=e,this.phi=t,this.theta=n,this}copy(e){return this.radius=e.radius,this.phi=e.phi,this.theta=e.theta,this}makeSafe(){return this.phi=qe(this.phi,1e-6,Math.PI-1e-6),this}setFromVector3(e){return this.setFromCartesianCoords(e.x,e.y,e.z)}setFromCartesianCoords(e,t,n){return this.radius=Math.sqrt(e*e+t*t+n*n),this.radius===0?(this.theta=0,this.phi=0):(this.theta=Math.atan2(e,n),this.phi=Math.acos(qe(t/this.radius,-1,1))),this}clone(){return new this.constructor().copy(this)}};var $h=class{static{this.prototype.isMatrix2=!0}constructor(e,t,n,i){this.elements=[1,0,0,1],e!==void 0&&this.set(e,t,n,i)}identity(){return this.set(1,0,0,1),this}fromArray(e,t=0){for(let n=0;n<4;n++)this.elements[n]=e[n+t];return this}set(e,t,n,i){let r=this.elements;return r[0]=e,r[2]=t,r[1]=n,r[3]=i,this}};var kf=new S,Aa,Nh,vo=class extends it{constructor(e=new S(0,0,1),t=new S(0,0,0),n=1,i=16776960,r=n*.2,o=r*.2){super(),this.type="ArrowHelper",Aa===void 0&&(Aa=new Ye,Aa.setAttribute("position",new Ue([0,0,0,0,1,0],3)),Nh=new fr(.5,1,5,1),Nh.translate(0,-.5,0)),this.position.copy(t),this.line=new In(Aa,new Ot({color:i,toneMapped:!1})),this.line.matrixAutoUpdate=!1,this.add(this.line),this.cone=new ue(Nh,new lt({color:i,toneMapped:!1})),this.cone.matrixAutoUpdate=!1,this.add(this.cone),this.setDirection(e),this.setLength(n,r,o)}setDirection(e){if(e.y>.99999)this.quaternion.set(0,0,0,1);else if(e.y<-.99999)this.quaternion.set(1,0,0,0);else{kf.set(e.z,0,-e.x).normalize();let t=Math.acos(e.y);this.quaternion.setFromAxisAngle(kf,t)}}setLength(e,t=e*.2,n=t*.2){this.line.scale.set(1,Math.max(1e-4,e-t),1),this.line.updateMatrix(),this.cone.scale.set(n,t,n),this.cone.position.y=e,this.cone.updateMatrix()}setColor(e){this.line.material.color.set(e),this.cone.material.color.set(e)}copy(e){return super.copy(e,!1),this.line.copy(e.line),this.cone.copy(e.cone),this}dispose(){super.dispose(),this.line.geometry.dispose(),this.line.material.dispose(),this.cone.geometry.dispose(),this.cone.material.dispose()}};var _o=class extends Bn{constructor(e,t=null){super(),this.object=e,this.domElement=t,this.enabled=!0,this.state=-1,this.keys={},this.mouseButtons={LEFT:null,MIDDLE:null,RIGHT:null},this.touches={ONE:null,TWO:null}}connect(e){this.domElement!==null&&this.disconnect(),this.domElement=e}disconnect(){}dispose(){}update(){}};function Au(s,e,t,n){let i=lx(n);switch(t){case uu:return s*e;case rl:return s*e/i.components*i.byteLength;case ol:return s*e/i.components*i.byteLength;case Ji:return s*e*2/i.components*i.byteLength;case al:return s*e*2/i.components*i.byteLength;case du:return s*e*3/i.components*i.byteLength;case Dn:return s*e*4/i.components*i.byteLength;case ll:return s*e*4/i.components*i.byteLength;case Mo:case wo:return Math.floor((s+3)/4)*Math.floor((e+3)/4)*8;case So:case To:return Math.floor((s+3)/4)*Math.floor((e+3)/4)*16;case hl:case dl:return Math.max(s,16)*Math.max(e,8)/4;case cl:case ul:return Math.max(s,8)*Math.max(e,8)/2;case fl:case pl:case gl:case xl:return Math.floor((s+3)/4)*Math.floor((e+3)/4)*8;case ml:case Ao:case yl:return Math.floor((s+3)/4)*Math.floor((e+3)/4)*16;case vl:return Math.floor((s+3)/4)*Math.floor((e+3)/4)*16;case _l:return Math.floor((s+4)/5)*Math.floor((e+3)/4)*16;case bl:return Math.floor((s+4)/5)*Math.floor((e+4)/5)*16;case Ml:return Math.floor((s+5)/6)*Math.floor((e+4)/5)*16;case wl:return Math.floor((s+5)/6)*Math.floor((e+5)/6)*16;case Sl:return Math.floor((s+7)/8)*Math.floor((e+4)/5)*16;case Tl:return Math.floor((s+7)/8)*Math.floor((e+5)/6)*16;case Al:return Math.floor((s+7)/8)*Math.floor((e+7)/8)*16;case El:return Math.floor((s+9)/10)*Math.floor((e+4)/5)*16;case Rl:return Math.floor((s+9)/10)*Math.floor((e+5)/6)*16;case Cl:return Math.floor((s+9)/10)*Math.floor((e+7)/8)*16;case Pl:return Math.floor((s+9)/10)*Math.floor((e+9)/10)*16;case Il:return Math.floor((s+11)/12)*Math.floor((e+9)/10)*16;case Ll:return Math.floor((s+11)/12)*Math.floor((e+11)/12)*16;case Dl:case Nl:case Ol:return Math.ceil(s/4)*Math.ceil(e/4)*16;case Ul:case Fl:return Math.ceil(s/4)*Math.ceil(e/4)*8;case Eo:case kl:return Math.ceil(s/4)*Math.ceil(e/4)*16}throw new Error(`Unable to determine texture byte length for ${t} format.`)}function lx(s){switch(s){case pn:case au:return{byteLength:1,components:1};case Mr:case lu:case bn:return{byteLength:2,components:1};case il:case sl:return{byteLength:2,components:4};case Vn:case nl:case _n:return{byteLength:4,components:1};case cu:case hu:return{byteLength:4,components:3}}throw new Error(`THREE.TextureUtils: Unknown texture type ${s}.`)}typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("register",{detail:{revision:"187"}}));typeof window<"u"&&(window.__THREE__?Ee("WARNING: Multiple instances of Three.js being imported."):window.__THREE__="187");function Yp(){let s=null,e=!1,t=null,n=null;function i(r,o){n=s.requestAnimationFrame(i),t(r,o)}return{start:function(){e!==!0&&t!==null&&s!==null&&(n=s.requestAnimationFrame(i),e=!0)},stop:function(){s!==null&&s.cancelAnimationFrame(n),e=!1},setAnimationLoop:function(r){t=r},setContext:function(r){s=r}}}function hx(s){let e=new WeakMap;function t(a,l){let c=a.array,h=a.usage,u=c.byteLength,d=s.createBuffer();s.bindBuffer(l,d),s.bufferData(l,c,h),a.onUploadCallback();let f;if(c instanceof Float32Array)f=s.FLOAT;else if(typeof Float16Array<"u"&&c instanceof Float16Array)f=s.HALF_FLOAT;else if(c instanceof Uint16Array)a.isFloat16BufferAttribute?f=s.HALF_FLOAT:f=s.UNSIGNED_SHORT;else if(c instanceof Int16Array)f=s.SHORT;else if(c instanceof Uint32Array)f=s.UNSIGNED_INT;else if(c instanceof Int32Array)f=s.INT;else if(c instanceof Int8Array)f=s.BYTE;else if(c instanceof Uint8Array)f=s.UNSIGNED_BYTE;else if(c instanceof Uint8ClampedArray)f=s.UNSIGNED_BYTE;else throw new Error("THREE.WebGLAttributes: Unsupported buffer data format: "+c);return{buffer:d,type:f,bytesPerElement:c.BYTES_PER_ELEMENT,version:a.version,size:u}}function n(a,l,c){let h=l.array,u=l.updateRanges;if(s.bindBuffer(c,a),u.length===0)s.bufferSubData(c,0,h);else{u.sort((f,g)=>f.start-g.start);let d=0;for(let f=1;f<u.length;f++){let g=u[d],y=u[f];y.start<=g.start+g.count+1?g.count=Math.max(g.count,y.start+y.count-g.start):(++d,u[d]=y)}u.length=d+1;for(let f=0,g=u.length;f<g;f++){let y=u[f];s.bufferSubData(c,y.start*h.BYTES_PER_ELEMENT,h,y.start,y.count)}l.clearUpdateRanges()}l.onUploadCallback()}function i(a){return a.isInterleavedBufferAttribute&&(a=a.data),e.get(a)}function r(a){a.isInterleavedBufferAttribute&&(a=a.data);let l=e.get(a);l&&(s.deleteBuffer(l.buffer),e.delete(a))}function o(a,l){if(a.isInterleavedBufferAttribute&&(a=a.data),a.isGLBufferAttribute){let h=e.get(a);(!h||h.version<a.version)&&e.set(a,{buffer:a.buffer,type:a.type,bytesPerElement:a.elementSize,version:a.version});return}let c=e.get(a);if(c===void 0)e.set(a,t(a,l));else if(c.version<a.version){if(c.size!==a.array.byteLength)throw new Error("THREE.WebGLAttributes: The size of the buffer attribute's array buffer does not match the original size. Resizing buffer attributes is not supported.");n(c.buffer,a,l),c.version=a.version}}return{get:i,remove:r,update:o}}var ux=`#ifdef USE_ALPHAHASH
	if ( diffuseColor.a < getAlphaHashThreshold( vPosition ) ) discard;
#endif`,dx=`#ifdef USE_ALPHAHASH
	const float ALPHA_HASH_SCALE = 0.05;
	float hash2D( vec2 value ) {
		return fract( 1.0e4 * sin( 17.0 * value.x + 0.1 * value.y ) * ( 0.1 + abs( sin( 13.0 * value.y + value.x ) ) ) );
	}
	float hash3D( vec3 value ) {
		return hash2D( vec2( hash2D( value.xy ), value.z ) );
	}
	float getAlphaHashThreshold( vec3 position ) {
		float maxDeriv = max(
			length( dFdx( position.xyz ) ),
			length( dFdy( position.xyz ) )
		);
		float pixScale = 1.0 / ( ALPHA_HASH_SCALE * maxDeriv );
		vec2 pixScales = vec2(
			exp2( floor( log2( pixScale ) ) ),
			exp2( ceil( log2( pixScale ) ) )
		);
		vec2 alpha = vec2(
			hash3D( floor( pixScales.x * position.xyz ) ),
			hash3D( floor( pixScales.y * position.xyz ) )
		);
		float lerpFactor = fract( log2( pixScale ) );
		float x = ( 1.0 - lerpFactor ) * alpha.x + lerpFactor * alpha.y;
		float a = min( lerpFactor, 1.0 - lerpFactor );
		vec3 cases = vec3(
			x * x / ( 2.0 * a * ( 1.0 - a ) ),
			( x - 0.5 * a ) / ( 1.0 - a ),
			1.0 - ( ( 1.0 - x ) * ( 1.0 - x ) / ( 2.0 * a * ( 1.0 - a ) ) )
		);
		float threshold = ( x < ( 1.0 - a ) )
			? ( ( x < a ) ? cases.x : cases.y )
			: cases.z;
		return clamp( threshold , 1.0e-6, 1.0 );
	}
#endif`,fx=`#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, vAlphaMapUv ).g;
#endif`,px=`#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,mx=`#ifdef USE_ALPHATEST
	#ifdef ALPHA_TO_COVERAGE
	diffuseColor.a = smoothstep( alphaTest, alphaTest + fwidth( diffuseColor.a ), diffuseColor.a );
	if ( diffuseColor.a == 0.0 ) discard;
	#else
	if ( diffuseColor.a < alphaTest ) discard;
	#endif
#endif`,gx=`#ifdef USE_ALPHATEST
	uniform float alphaTest;
#endif`,xx=`#ifdef USE_AOMAP
	float ambientOcclusion = ( texture2D( aoMap, vAoMapUv ).r - 1.0 ) * aoMapIntensity + 1.0;
	reflectedLight.indirectDiffuse *= ambientOcclusion;
	#if defined( USE_CLEARCOAT ) 
		clearcoatSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_SHEEN ) 
		sheenSpecularIndirect *= ambientOcclusion;
	#endif
	#if defined( USE_ENVMAP ) && defined( STANDARD )
		float dotNV = saturate( dot( geometryNormal, geometryViewDir ) );
		reflectedLight.indirectSpecular *= computeSpecularOcclusion( dotNV, ambientOcclusion, material.roughness );
	#endif
#endif`,yx=`#ifdef USE_AOMAP
	uniform sampler2D aoMap;
	uniform float aoMapIntensity;
#endif`,vx=`#ifdef USE_BATCHING
	#if ! defined( GL_ANGLE_multi_draw )
	#define gl_DrawID _gl_DrawID
	uniform int _gl_DrawID;
	#endif
	uniform highp sampler2D batchingTexture;
	uniform highp usampler2D batchingIdTexture;
	mat4 getBatchingMatrix( const in float i ) {
		int size = textureSize( batchingTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( batchingTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( batchingTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( batchingTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( batchingTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
	float getIndirectIndex( const in int i ) {
		int size = textureSize( batchingIdTexture, 0 ).x;
		int x = i % size;
		int y = i / size;
		return float( texelFetch( batchingIdTexture, ivec2( x, y ), 0 ).r );
	}
#endif
#ifdef USE_BATCHING_COLOR
	uniform sampler2D batchingColorTexture;
	vec4 getBatchingColor( const in float i ) {
		int size = textureSize( batchingColorTexture, 0 ).x;
		int j = int( i );
		int x = j % size;
		int y = j / size;
		return texelFetch( batchingColorTexture, ivec2( x, y ), 0 );
	}
#endif`,_x=`#ifdef USE_BATCHING
	mat4 batchingMatrix = getBatchingMatrix( getIndirectIndex( gl_DrawID ) );
#endif`,bx=`vec3 transformed = vec3( position );
#ifdef USE_ALPHAHASH
	vPosition = vec3( position );
#endif`,Mx=`vec3 objectNormal = vec3( normal );
#ifdef USE_TANGENT
	vec3 objectTangent = vec3( tangent.xyz );
#endif`,wx=`float G_BlinnPhong_Implicit( ) {
	return 0.25;
}
float D_BlinnPhong( const in float shininess, const in float dotNH ) {
	return RECIPROCAL_PI * ( shininess * 0.5 + 1.0 ) * pow( dotNH, shininess );
}
vec3 BRDF_BlinnPhong( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in vec3 specularColor, const in float shininess ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( specularColor, 1.0, dotVH );
	float G = G_BlinnPhong_Implicit( );
	float D = D_BlinnPhong( shininess, dotNH );
	return F * ( G * D );
} // validated`,Sx=`#ifdef USE_IRIDESCENCE
	const mat3 XYZ_TO_REC709 = mat3(
		 3.2404542, -0.9692660,  0.0556434,
		-1.5371385,  1.8760108, -0.2040259,
		-0.4985314,  0.0415560,  1.0572252
	);
	vec3 Fresnel0ToIor( vec3 fresnel0 ) {
		vec3 sqrtF0 = sqrt( fresnel0 );
		return ( vec3( 1.0 ) + sqrtF0 ) / ( vec3( 1.0 ) - sqrtF0 );
	}
	vec3 IorToFresnel0( vec3 transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - vec3( incidentIor ) ) / ( transmittedIor + vec3( incidentIor ) ) );
	}
	float IorToFresnel0( float transmittedIor, float incidentIor ) {
		return pow2( ( transmittedIor - incidentIor ) / ( transmittedIor + incidentIor ));
	}
	vec3 evalSensitivity( float OPD, vec3 shift ) {
		float phase = 2.0 * PI * OPD * 1.0e-9;
		vec3 val = vec3( 5.4856e-13, 4.4201e-13, 5.2481e-13 );
		vec3 pos = vec3( 1.6810e+06, 1.7953e+06, 2.2084e+06 );
		vec3 var = vec3( 4.3278e+09, 9.3046e+09, 6.6121e+09 );
		vec3 xyz = val * sqrt( 2.0 * PI * var ) * cos( pos * phase + shift ) * exp( - pow2( phase ) * var );
		xyz.x += 9.7470e-14 * sqrt( 2.0 * PI * 4.5282e+09 ) * cos( 2.2399e+06 * phase + shift[ 0 ] ) * exp( - 4.5282e+09 * pow2( phase ) );
		xyz /= 1.0685e-7;
		vec3 rgb = XYZ_TO_REC709 * xyz;
		return rgb;
	}
	vec3 evalIridescence( float outsideIOR, float eta2, float cosTheta1, float thinFilmThickness, vec3 baseF0 ) {
		vec3 I;
		float iridescenceIOR = mix( outsideIOR, eta2, smoothstep( 0.0, 0.03, thinFilmThickness ) );
		float sinTheta2Sq = pow2( outsideIOR / iridescenceIOR ) * ( 1.0 - pow2( cosTheta1 ) );
		float cosTheta2Sq = 1.0 - sinTheta2Sq;
		if ( cosTheta2Sq < 0.0 ) {
			return vec3( 1.0 );
		}
		float cosTheta2 = sqrt( cosTheta2Sq );
		float R0 = IorToFresnel0( iridescenceIOR, outsideIOR );
		float R12 = F_Schlick( R0, 1.0, cosTheta1 );
		float T121 = 1.0 - R12;
		float phi12 = 0.0;
		if ( iridescenceIOR < outsideIOR ) phi12 = PI;
		float phi21 = PI - phi12;
		vec3 baseIOR = Fresnel0ToIor( clamp( baseF0, 0.0, 0.9999 ) );		vec3 R1 = IorToFresnel0( baseIOR, iridescenceIOR );
		vec3 R23 = F_Schlick( R1, 1.0, cosTheta2 );
		vec3 phi23 = vec3( 0.0 );
		if ( baseIOR[ 0 ] < iridescenceIOR ) phi23[ 0 ] = PI;
		if ( baseIOR[ 1 ] < iridescenceIOR ) phi23[ 1 ] = PI;
		if ( baseIOR[ 2 ] < iridescenceIOR ) phi23[ 2 ] = PI;
		float OPD = 2.0 * iridescenceIOR * thinFilmThickness * cosTheta2;
		vec3 phi = vec3( phi21 ) + phi23;
		vec3 R123 = clamp( R12 * R23, 1e-5, 0.9999 );
		vec3 r123 = sqrt( R123 );
		vec3 Rs = pow2( T121 ) * R23 / ( vec3( 1.0 ) - R123 );
		vec3 C0 = R12 + Rs;
		I = C0;
		vec3 Cm = Rs - T121;
		for ( int m = 1; m <= 2; ++ m ) {
			Cm *= r123;
			vec3 Sm = 2.0 * evalSensitivity( float( m ) * OPD, float( m ) * phi );
			I += Cm * Sm;
		}
		return max( I, vec3( 0.0 ) );
	}
#endif`,Tx=`#ifdef USE_BUMPMAP
	uniform sampler2D bumpMap;
	uniform float bumpScale;
	vec2 dHdxy_fwd() {
		vec2 dSTdx = dFdx( vBumpMapUv );
		vec2 dSTdy = dFdy( vBumpMapUv );
		float Hll = bumpScale * texture2D( bumpMap, vBumpMapUv ).x;
		float dBx = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdx ).x - Hll;
		float dBy = bumpScale * texture2D( bumpMap, vBumpMapUv + dSTdy ).x - Hll;
		return vec2( dBx, dBy );
	}
	vec3 perturbNormalArb( vec3 surf_pos, vec3 surf_norm, vec2 dHdxy, float faceDirection ) {
		vec3 vSigmaX = normalize( dFdx( surf_pos.xyz ) );
		vec3 vSigmaY = normalize( dFdy( surf_pos.xyz ) );
		vec3 vN = surf_norm;
		vec3 R1 = cross( vSigmaY, vN );
		vec3 R2 = cross( vN, vSigmaX );
		float fDet = dot( vSigmaX, R1 ) * faceDirection;
		vec3 vGrad = sign( fDet ) * ( dHdxy.x * R1 + dHdxy.y * R2 );
		return normalize( abs( fDet ) * surf_norm - vGrad );
	}
#endif`,Ax=`#if NUM_CLIPPING_PLANES > 0
	vec4 plane;
	#ifdef ALPHA_TO_COVERAGE
		float distanceToPlane, distanceGradient;
		float clipOpacity = 1.0;
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
			distanceGradient = fwidth( distanceToPlane ) / 2.0;
			clipOpacity *= smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			if ( clipOpacity == 0.0 ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			float unionClipOpacity = 1.0;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				distanceToPlane = - dot( vClipPosition, plane.xyz ) + plane.w;
				distanceGradient = fwidth( distanceToPlane ) / 2.0;
				unionClipOpacity *= 1.0 - smoothstep( - distanceGradient, distanceGradient, distanceToPlane );
			}
			#pragma unroll_loop_end
			clipOpacity *= 1.0 - unionClipOpacity;
		#endif
		diffuseColor.a *= clipOpacity;
		if ( diffuseColor.a == 0.0 ) discard;
	#else
		#pragma unroll_loop_start
		for ( int i = 0; i < UNION_CLIPPING_PLANES; i ++ ) {
			plane = clippingPlanes[ i ];
			if ( dot( vClipPosition, plane.xyz ) > plane.w ) discard;
		}
		#pragma unroll_loop_end
		#if UNION_CLIPPING_PLANES < NUM_CLIPPING_PLANES
			bool clipped = true;
			#pragma unroll_loop_start
			for ( int i = UNION_CLIPPING_PLANES; i < NUM_CLIPPING_PLANES; i ++ ) {
				plane = clippingPlanes[ i ];
				clipped = ( dot( vClipPosition, plane.xyz ) > plane.w ) && clipped;
			}
			#pragma unroll_loop_end
			if ( clipped ) discard;
		#endif
	#endif
#endif`,Ex=`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
	uniform vec4 clippingPlanes[ NUM_CLIPPING_PLANES ];
#endif`,Rx=`#if NUM_CLIPPING_PLANES > 0
	varying vec3 vClipPosition;
#endif`,Cx=`#if NUM_CLIPPING_PLANES > 0
	vClipPosition = - mvPosition.xyz;
#endif`,Px=`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA )
	diffuseColor *= vColor;
#endif`,Ix=`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA )
	varying vec4 vColor;
#endif`,Lx=`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	varying vec4 vColor;
#endif`,Dx=`#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR ) || defined( USE_BATCHING_COLOR )
	vColor = vec4( 1.0 );
#endif
#ifdef USE_COLOR_ALPHA
	vColor *= color;
#elif defined( USE_COLOR )
	vColor.rgb *= color;
#endif
#ifdef USE_INSTANCING_COLOR
	vColor.rgb *= instanceColor.rgb;
#endif
#ifdef USE_BATCHING_COLOR
	vColor *= getBatchingColor( getIndirectIndex( gl_DrawID ) );
#endif`,Nx=`#define PI 3.141592653589793
#define PI2 6.283185307179586
#define PI_HALF 1.5707963267948966
#define RECIPROCAL_PI 0.3183098861837907
#define RECIPROCAL_PI2 0.15915494309189535
#define EPSILON 1e-6
#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
#define whiteComplement( a ) ( 1.0 - saturate( a ) )
float pow2( const in float x ) { return x*x; }
vec3 pow2( const in vec3 x ) { return x*x; }
float pow3( const in float x ) { return x*x*x; }
float pow4( const in float x ) { float x2 = x*x; return x2*x2; }
float max3( const in vec3 v ) { return max( max( v.x, v.y ), v.z ); }
float average( const in vec3 v ) { return dot( v, vec3( 0.3333333 ) ); }
highp float rand( const in vec2 uv ) {
	const highp float a = 12.9898, b = 78.233, c = 43758.5453;
	highp float dt = dot( uv.xy, vec2( a,b ) ), sn = mod( dt, PI );
	return fract( sin( sn ) * c );
}
#ifdef HIGH_PRECISION
	float precisionSafeLength( vec3 v ) { return length( v ); }
#else
	float precisionSafeLength( vec3 v ) {
		float maxComponent = max3( abs( v ) );
		return length( v / maxComponent ) * maxComponent;
	}
#endif
struct IncidentLight {
	vec3 color;
	vec3 direction;
	bool visible;
};
struct ReflectedLight {
	vec3 directDiffuse;
	vec3 directSpecular;
	vec3 indirectDiffuse;
	vec3 indirectSpecular;
};
#ifdef USE_ALPHAHASH
	varying vec3 vPosition;
#endif
vec3 transformDirection( in vec3 dir, in mat4 matrix ) {
	return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );
}
#define inverseTransformDirection transformDirectionByInverseViewMatrix
vec3 transformNormalByInverseViewMatrix( in vec3 normal, in mat4 viewMatrix ) {
	return normalize( ( vec4( normal, 0.0 ) * viewMatrix ).xyz );
}
vec3 transformDirectionByInverseViewMatrix( in vec3 dir, in mat4 viewMatrix ) {
	return normalize( ( vec4( dir, 0.0 ) * viewMatrix ).xyz );
}
bool isPerspectiveMatrix( mat4 m ) {
	return m[ 2 ][ 3 ] == - 1.0;
}
vec2 equirectUv( in vec3 dir ) {
	float u = atan( dir.z, dir.x ) * RECIPROCAL_PI2 + 0.5;
	float v = asin( clamp( dir.y, - 1.0, 1.0 ) ) * RECIPROCAL_PI + 0.5;
	return vec2( u, v );
}
vec3 BRDF_Lambert( const in vec3 diffuseColor ) {
	return RECIPROCAL_PI * diffuseColor;
}
vec3 F_Schlick( const in vec3 f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
}
float F_Schlick( const in float f0, const in float f90, const in float dotVH ) {
	float fresnel = exp2( ( - 5.55473 * dotVH - 6.98316 ) * dotVH );
	return f0 * ( 1.0 - fresnel ) + ( f90 * fresnel );
} // validated`,Ox=`vec3 transformedNormal = objectNormal;
#ifdef USE_TANGENT
	vec3 transformedTangent = objectTangent;
#endif
#ifdef USE_BATCHING
	mat3 bm = mat3( batchingMatrix );
	transformedNormal /= vec3( dot( bm[ 0 ], bm[ 0 ] ), dot( bm[ 1 ], bm[ 1 ] ), dot( bm[ 2 ], bm[ 2 ] ) );
	transformedNormal = bm * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = bm * transformedTangent;
	#endif
#endif
#ifdef USE_INSTANCING
	mat3 im = mat3( instanceMatrix );
	transformedNormal /= vec3( dot( im[ 0 ], im[ 0 ] ), dot( im[ 1 ], im[ 1 ] ), dot( im[ 2 ], im[ 2 ] ) );
	transformedNormal = im * transformedNormal;
	#ifdef USE_TANGENT
		transformedTangent = im * transformedTangent;
	#endif
#endif
transformedNormal = normalMatrix * transformedNormal;
#ifdef FLIP_SIDED
	transformedNormal = - transformedNormal;
#endif
#ifdef USE_TANGENT
	transformedTangent = ( modelViewMatrix * vec4( transformedTangent, 0.0 ) ).xyz;
#endif`,Ux=`#ifdef USE_DISPLACEMENTMAP
	uniform sampler2D displacementMap;
	uniform float displacementScale;
	uniform float displacementBias;
#endif`,Fx=`#ifdef USE_DISPLACEMENTMAP
	transformed += normalize( objectNormal ) * ( texture2D( displacementMap, vDisplacementMapUv ).x * displacementScale + displacementBias );
#endif`,kx=`#ifdef USE_EMISSIVEMAP
	vec4 emissiveColor = texture2D( emissiveMap, vEmissiveMapUv );
	#ifdef DECODE_VIDEO_TEXTURE_EMISSIVE
		emissiveColor = sRGBTransferEOTF( emissiveColor );
	#endif
	totalEmissiveRadiance *= emissiveColor.rgb;
#endif`,Bx=`#ifdef USE_EMISSIVEMAP
	uniform sampler2D emissiveMap;
#endif`,zx="gl_FragColor = linearToOutputTexel( gl_FragColor );",Hx=`vec4 LinearTransferOETF( in vec4 value ) {
	return value;
}
vec4 sRGBTransferEOTF( in vec4 value ) {
	return vec4( mix( pow( value.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), value.rgb * 0.0773993808, vec3( lessThanEqual( value.rgb, vec3( 0.04045 ) ) ) ), value.a );
}
vec4 sRGBTransferOETF( in vec4 value ) {
	return vec4( mix( pow( value.rgb, vec3( 0.41666 ) ) * 1.055 - vec3( 0.055 ), value.rgb * 12.92, vec3( lessThanEqual( value.rgb, vec3( 0.0031308 ) ) ) ), value.a );
}`,Gx=`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vec3 cameraToFrag;
		if ( isOrthographic ) {
			cameraToFrag = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToFrag = normalize( vWorldPosition - cameraPosition );
		}
		vec3 worldNormal = transformNormalByInverseViewMatrix( normal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vec3 reflectVec = reflect( cameraToFrag, worldNormal );
		#else
			vec3 reflectVec = refract( cameraToFrag, worldNormal, refractionRatio );
		#endif
	#else
		vec3 reflectVec = vReflect;
	#endif
	#ifdef ENVMAP_TYPE_CUBE
		vec4 envColor = textureCube( envMap, envMapRotation * reflectVec );
		#ifdef ENVMAP_BLENDING_MULTIPLY
			outgoingLight = mix( outgoingLight, outgoingLight * envColor.xyz, specularStrength * reflectivity );
		#elif defined( ENVMAP_BLENDING_MIX )
			outgoingLight = mix( outgoingLight, envColor.xyz, specularStrength * reflectivity );
		#elif defined( ENVMAP_BLENDING_ADD )
			outgoingLight += envColor.xyz * specularStrength * reflectivity;
		#endif
	#endif
#endif`,Vx=`#ifdef USE_ENVMAP
	uniform float envMapIntensity;
	uniform mat3 envMapRotation;
	uniform samplerCube envMap;
	#ifdef ENVMAP_TYPE_PMREM
		float roughnessToMip( const in float roughness ) {
			float r = clamp( roughness, 0.0, 1.0 );
			return ENVMAP_MAX_LOD * r * ( 2.0 - r );
		}
	#endif
#endif`,Wx=`#ifdef USE_ENVMAP
	uniform float reflectivity;
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		varying vec3 vWorldPosition;
		uniform float refractionRatio;
	#else
		varying vec3 vReflect;
	#endif
#endif`,Xx=`#ifdef USE_ENVMAP
	#if defined( USE_BUMPMAP ) || defined( USE_NORMALMAP ) || defined( PHONG ) || defined( LAMBERT )
		#define ENV_WORLDPOS
	#endif
	#ifdef ENV_WORLDPOS
		
		varying vec3 vWorldPosition;
	#else
		varying vec3 vReflect;
		uniform float refractionRatio;
	#endif
#endif`,qx=`#ifdef USE_ENVMAP
	#ifdef ENV_WORLDPOS
		vWorldPosition = worldPosition.xyz;
	#else
		vec3 cameraToVertex;
		if ( isOrthographic ) {
			cameraToVertex = normalize( vec3( - viewMatrix[ 0 ][ 2 ], - viewMatrix[ 1 ][ 2 ], - viewMatrix[ 2 ][ 2 ] ) );
		} else {
			cameraToVertex = normalize( worldPosition.xyz - cameraPosition );
		}
		vec3 worldNormal = transformNormalByInverseViewMatrix( transformedNormal, viewMatrix );
		#ifdef ENVMAP_MODE_REFLECTION
			vReflect = reflect( cameraToVertex, worldNormal );
		#else
			vReflect = refract( cameraToVertex, worldNormal, refractionRatio );
		#endif
	#endif
#endif`,$x=`#ifdef USE_FOG
	vFogDepth = - mvPosition.z;
#endif`,Yx=`#ifdef USE_FOG
	varying float vFogDepth;
#endif`,Kx=`#ifdef USE_FOG
	#ifdef FOG_EXP2
		float fogFactor = 1.0 - exp( - fogDensity * fogDensity * vFogDepth * vFogDepth );
	#else
		float fogFactor = smoothstep( fogNear, fogFar, vFogDepth );
	#endif
	gl_FragColor.rgb = mix( gl_FragColor.rgb, fogColor, fogFactor );
#endif`,jx=`#ifdef USE_FOG
	uniform vec3 fogColor;
	varying float vFogDepth;
	#ifdef FOG_EXP2
		uniform float fogDensity;
	#else
		uniform float fogNear;
		uniform float fogFar;
	#endif
#endif`,Zx=`#ifdef USE_GRADIENTMAP
	uniform sampler2D gradientMap;
#endif
vec3 getGradientIrradiance( vec3 normal, vec3 lightDirection ) {
	float dotNL = dot( normal, lightDirection );
	vec2 coord = vec2( dotNL * 0.5 + 0.5, 0.0 );
	#ifdef USE_GRADIENTMAP
		return vec3( texture2D( gradientMap, coord ).r );
	#else
		vec2 fw = fwidth( coord ) * 0.5;
		return mix( vec3( 0.7 ), vec3( 1.0 ), smoothstep( 0.7 - fw.x, 0.7 + fw.x, coord.x ) );
	#endif
}`,Jx=`#ifdef USE_LIGHTMAP
	uniform sampler2D lightMap;
	uniform float lightMapIntensity;
#endif`,Qx=`LambertMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularStrength = specularStrength;`,ey=`varying vec3 vViewPosition;
struct LambertMaterial {
	vec3 diffuseColor;
	float specularStrength;
};
void RE_Direct_Lambert( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Lambert( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Lambert
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Lambert`,ty=`uniform bool receiveShadow;
uniform vec3 ambientLightColor;
#if defined( USE_LIGHT_PROBES )
	uniform vec3 lightProbe[ 9 ];
#endif
vec3 shGetIrradianceAt( in vec3 normal, in vec3 shCoefficients[ 9 ] ) {
	float x = normal.x, y = normal.y, z = normal.z;
	vec3 result = shCoefficients[ 0 ] * 0.886227;
	result += shCoefficients[ 1 ] * 2.0 * 0.511664 * y;
	result += shCoefficients[ 2 ] * 2.0 * 0.511664 * z;
	result += shCoefficients[ 3 ] * 2.0 * 0.511664 * x;
	result += shCoefficients[ 4 ] * 2.0 * 0.429043 * x * y;
	result += shCoefficients[ 5 ] * 2.0 * 0.429043 * y * z;
	result += shCoefficients[ 6 ] * ( 0.743125 * z * z - 0.247708 );
	result += shCoefficients[ 7 ] * 2.0 * 0.429043 * x * z;
	result += shCoefficients[ 8 ] * 0.429043 * ( x * x - y * y );
	return result;
}
vec3 getLightProbeIrradiance( const in vec3 lightProbe[ 9 ], const in vec3 normal ) {
	vec3 worldNormal = transformNormalByInverseViewMatrix( normal, viewMatrix );
	vec3 irradiance = shGetIrradianceAt( worldNormal, lightProbe );
	return irradiance;
}
vec3 getAmbientLightIrradiance( const in vec3 ambientLightColor ) {
	vec3 irradiance = ambientLightColor;
	return irradiance;
}
float getDistanceAttenuation( const in float lightDistance, const in float cutoffDistance, const in float decayExponent ) {
	float distanceFalloff = 1.0 / max( pow( lightDistance, decayExponent ), 0.01 );
	if ( cutoffDistance > 0.0 ) {
		distanceFalloff *= pow2( saturate( 1.0 - pow4( lightDistance / cutoffDistance ) ) );
	}
	return distanceFalloff;
}
float getSpotAttenuation( const in float coneCosine, const in float penumbraCosine, const in float angleCosine ) {
	return smoothstep( coneCosine, penumbraCosine, angleCosine );
}
#if NUM_SUN_LIGHTS > 0
	struct SunLight {
		vec3 direction;
		vec3 color;
	};
	uniform SunLight sunLights[ NUM_SUN_LIGHTS ];
	void getSunLightInfo( const in SunLight sunLight, out IncidentLight light ) {
		light.color = sunLight.color;
		light.direction = sunLight.direction;
		light.visible = true;
	}
#endif
#if NUM_DIR_LIGHTS > 0
	struct DirectionalLight {
		vec3 direction;
		vec3 color;
	};
	uniform DirectionalLight directionalLights[ NUM_DIR_LIGHTS ];
	void getDirectionalLightInfo( const in DirectionalLight directionalLight, out IncidentLight light ) {
		light.color = directionalLight.color;
		light.direction = directionalLight.direction;
		light.visible = true;
	}
#endif
#if NUM_POINT_LIGHTS > 0
	struct PointLight {
		vec3 position;
		vec3 color;
		float distance;
		float decay;
	};
	uniform PointLight pointLights[ NUM_POINT_LIGHTS ];
	void getPointLightInfo( const in PointLight pointLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = pointLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float lightDistance = length( lVector );
		light.color = pointLight.color;
		light.color *= getDistanceAttenuation( lightDistance, pointLight.distance, pointLight.decay );
		light.visible = ( light.color != vec3( 0.0 ) );
	}
#endif
#if NUM_SPOT_LIGHTS > 0
	struct SpotLight {
		vec3 position;
		vec3 direction;
		vec3 color;
		float distance;
		float decay;
		float coneCos;
		float penumbraCos;
	};
	uniform SpotLight spotLights[ NUM_SPOT_LIGHTS ];
	void getSpotLightInfo( const in SpotLight spotLight, const in vec3 geometryPosition, out IncidentLight light ) {
		vec3 lVector = spotLight.position - geometryPosition;
		light.direction = normalize( lVector );
		float angleCos = dot( light.direction, spotLight.direction );
		float spotAttenuation = getSpotAttenuation( spotLight.coneCos, spotLight.penumbraCos, angleCos );
		if ( spotAttenuation > 0.0 ) {
			float lightDistance = length( lVector );
			light.color = spotLight.color * spotAttenuation;
			light.color *= getDistanceAttenuation( lightDistance, spotLight.distance, spotLight.decay );
			light.visible = ( light.color != vec3( 0.0 ) );
		} else {
			light.color = vec3( 0.0 );
			light.visible = false;
		}
	}
#endif
#if NUM_RECT_AREA_LIGHTS > 0
	struct RectAreaLight {
		vec3 color;
		vec3 position;
		vec3 halfWidth;
		vec3 halfHeight;
	};
	uniform sampler2D ltc_1;	uniform sampler2D ltc_2;
	uniform RectAreaLight rectAreaLights[ NUM_RECT_AREA_LIGHTS ];
#endif
#if NUM_HEMI_LIGHTS > 0
	struct HemisphereLight {
		vec3 direction;
		vec3 skyColor;
		vec3 groundColor;
	};
	uniform HemisphereLight hemisphereLights[ NUM_HEMI_LIGHTS ];
	vec3 getHemisphereLightIrradiance( const in HemisphereLight hemiLight, const in vec3 normal ) {
		float dotNL = dot( normal, hemiLight.direction );
		float hemiDiffuseWeight = 0.5 * dotNL + 0.5;
		vec3 irradiance = mix( hemiLight.groundColor, hemiLight.skyColor, hemiDiffuseWeight );
		return irradiance;
	}
#endif
#include <lightprobes_pars_fragment>`,ny=`#ifdef USE_ENVMAP
	vec3 getIBLIrradiance( const in vec3 normal ) {
		#ifdef ENVMAP_TYPE_PMREM
			vec3 worldNormal = transformNormalByInverseViewMatrix( normal, viewMatrix );
			vec4 envMapColor = textureLod( envMap, envMapRotation * worldNormal, ENVMAP_MAX_LOD );
			return PI * envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	vec3 getIBLRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness ) {
		#ifdef ENVMAP_TYPE_PMREM
			vec3 reflectVec = reflect( - viewDir, normal );
			reflectVec = normalize( mix( reflectVec, normal, pow4( roughness ) ) );
			reflectVec = transformDirectionByInverseViewMatrix( reflectVec, viewMatrix );
			vec4 envMapColor = textureLod( envMap, envMapRotation * reflectVec, roughnessToMip( roughness ) );
			return envMapColor.rgb * envMapIntensity;
		#else
			return vec3( 0.0 );
		#endif
	}
	#ifdef USE_RETROREFLECTION
		vec3 getIBLRetroRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness ) {
			#ifdef ENVMAP_TYPE_PMREM
				vec3 retroVec = normalize( mix( viewDir, normal, pow4( roughness ) ) );
				retroVec = transformDirectionByInverseViewMatrix( retroVec, viewMatrix );
				vec4 envMapColor = textureLod( envMap, envMapRotation * retroVec, roughnessToMip( roughness ) );
				return envMapColor.rgb * envMapIntensity;
			#else
				return vec3( 0.0 );
			#endif
		}
	#endif
	#ifdef USE_ANISOTROPY
		vec3 getIBLAnisotropyRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness, const in vec3 bitangent, const in float anisotropy ) {
			#ifdef ENVMAP_TYPE_PMREM
				vec3 bentNormal = cross( bitangent, viewDir );
				bentNormal = normalize( cross( bentNormal, bitangent ) );
				bentNormal = normalize( mix( bentNormal, normal, pow2( pow2( 1.0 - anisotropy * ( 1.0 - roughness ) ) ) ) );
				return getIBLRadiance( viewDir, bentNormal, roughness );
			#else
				return vec3( 0.0 );
			#endif
		}
		#ifdef USE_RETROREFLECTION
			vec3 getIBLAnisotropyRetroRadiance( const in vec3 viewDir, const in vec3 normal, const in float roughness, const in vec3 bitangent, const in float anisotropy ) {
				#ifdef ENVMAP_TYPE_PMREM
					vec3 bentNormal = cross( bitangent, viewDir );
					bentNormal = normalize( cross( bentNormal, bitangent ) );
					bentNormal = normalize( mix( bentNormal, normal, pow2( pow2( 1.0 - anisotropy * ( 1.0 - roughness ) ) ) ) );
					return getIBLRetroRadiance( viewDir, bentNormal, roughness );
				#else
					return vec3( 0.0 );
				#endif
			}
		#endif
	#endif
#endif`,iy=`ToonMaterial material;
material.diffuseColor = diffuseColor.rgb;`,sy=`varying vec3 vViewPosition;
struct ToonMaterial {
	vec3 diffuseColor;
};
void RE_Direct_Toon( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	vec3 irradiance = getGradientIrradiance( geometryNormal, directLight.direction ) * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
void RE_IndirectDiffuse_Toon( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in ToonMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_Toon
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Toon`,ry=`BlinnPhongMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.specularColor = specular;
material.specularShininess = shininess;
material.specularStrength = specularStrength;`,oy=`varying vec3 vViewPosition;
struct BlinnPhongMaterial {
	vec3 diffuseColor;
	vec3 specularColor;
	float specularShininess;
	float specularStrength;
};
void RE_Direct_BlinnPhong( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	reflectedLight.directDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
	reflectedLight.directSpecular += irradiance * BRDF_BlinnPhong( directLight.direction, geometryViewDir, geometryNormal, material.specularColor, material.specularShininess ) * material.specularStrength;
}
void RE_IndirectDiffuse_BlinnPhong( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in BlinnPhongMaterial material, inout ReflectedLight reflectedLight ) {
	reflectedLight.indirectDiffuse += irradiance * BRDF_Lambert( material.diffuseColor );
}
#define RE_Direct				RE_Direct_BlinnPhong
#define RE_IndirectDiffuse		RE_IndirectDiffuse_BlinnPhong`,ay=`PhysicalMaterial material;
material.diffuseColor = diffuseColor.rgb;
material.diffuseContribution = diffuseColor.rgb * ( 1.0 - metalnessFactor );
material.metalness = metalnessFactor;
vec3 dxy = max( abs( dFdx( nonPerturbedNormal ) ), abs( dFdy( nonPerturbedNormal ) ) );
float geometryRoughness = max( max( dxy.x, dxy.y ), dxy.z );
material.roughness = max( roughnessFactor, 0.045 );
material.roughness += geometryRoughness;
material.roughness = min( material.roughness, 1.0 );
#ifdef USE_DIFFUSE_ROUGHNESS
	float diffuseRoughnessFactor = diffuseRoughness;
	#ifdef USE_DIFFUSE_ROUGHNESSMAP
		diffuseRoughnessFactor *= texture2D( diffuseRoughnessMap, vDiffuseRoughnessMapUv ).r;
	#endif
	material.diffuseRoughness = saturate( diffuseRoughnessFactor );
#endif
#ifdef IOR
	material.ior = ior;
	#ifdef USE_SPECULAR
		float specularIntensityFactor = specularIntensity;
		vec3 specularColorFactor = specularColor;
		#ifdef USE_SPECULAR_COLORMAP
			specularColorFactor *= texture2D( specularColorMap, vSpecularColorMapUv ).rgb;
		#endif
		#ifdef USE_SPECULAR_INTENSITYMAP
			specularIntensityFactor *= texture2D( specularIntensityMap, vSpecularIntensityMapUv ).a;
		#endif
		material.specularF90 = mix( specularIntensityFactor, 1.0, metalnessFactor );
	#else
		float specularIntensityFactor = 1.0;
		vec3 specularColorFactor = vec3( 1.0 );
		material.specularF90 = 1.0;
	#endif
	material.specularColor = min( pow2( ( material.ior - 1.0 ) / ( material.ior + 1.0 ) ) * specularColorFactor, vec3( 1.0 ) ) * specularIntensityFactor;
	material.specularColorBlended = mix( material.specularColor, diffuseColor.rgb, metalnessFactor );
#else
	material.specularColor = vec3( 0.04 );
	material.specularColorBlended = mix( material.specularColor, diffuseColor.rgb, metalnessFactor );
	material.specularF90 = 1.0;
#endif
#ifdef USE_CLEARCOAT
	material.clearcoat = clearcoat;
	material.clearcoatRoughness = clearcoatRoughness;
	material.clearcoatF0 = vec3( 0.04 );
	material.clearcoatF90 = 1.0;
	#ifdef USE_CLEARCOATMAP
		material.clearcoat *= texture2D( clearcoatMap, vClearcoatMapUv ).x;
	#endif
	#ifdef USE_CLEARCOAT_ROUGHNESSMAP
		material.clearcoatRoughness *= texture2D( clearcoatRoughnessMap, vClearcoatRoughnessMapUv ).y;
	#endif
	material.clearcoat = saturate( material.clearcoat );	material.clearcoatRoughness = max( material.clearcoatRoughness, 0.045 );
	material.clearcoatRoughness += geometryRoughness;
	material.clearcoatRoughness = min( material.clearcoatRoughness, 1.0 );
#endif
#ifdef USE_DISPERSION
	material.dispersion = dispersion;
#endif
#ifdef USE_RETROREFLECTION
	material.retroreflectivity = retroreflectivity;
#endif
#ifdef USE_IRIDESCENCE
	material.iridescence = iridescence;
	material.iridescenceIOR = iridescenceIOR;
	#ifdef USE_IRIDESCENCEMAP
		material.iridescence *= texture2D( iridescenceMap, vIridescenceMapUv ).r;
	#endif
	#ifdef USE_IRIDESCENCE_THICKNESSMAP
		material.iridescenceThickness = (iridescenceThicknessMaximum - iridescenceThicknessMinimum) * texture2D( iridescenceThicknessMap, vIridescenceThicknessMapUv ).g + iridescenceThicknessMinimum;
	#else
		material.iridescenceThickness = iridescenceThicknessMaximum;
	#endif
#endif
#ifdef USE_SHEEN
	material.sheenColor = sheenColor;
	#ifdef USE_SHEEN_COLORMAP
		material.sheenColor *= texture2D( sheenColorMap, vSheenColorMapUv ).rgb;
	#endif
	material.sheenRoughness = clamp( sheenRoughness, 0.0001, 1.0 );
	#ifdef USE_SHEEN_ROUGHNESSMAP
		material.sheenRoughness *= texture2D( sheenRoughnessMap, vSheenRoughnessMapUv ).a;
	#endif
#endif
#ifdef USE_ANISOTROPY
	#ifdef USE_ANISOTROPYMAP
		mat2 anisotropyMat = mat2( anisotropyVector.x, anisotropyVector.y, - anisotropyVector.y, anisotropyVector.x );
		vec3 anisotropyPolar = texture2D( anisotropyMap, vAnisotropyMapUv ).rgb;
		vec2 anisotropyV = anisotropyMat * normalize( 2.0 * anisotropyPolar.rg - vec2( 1.0 ) ) * anisotropyPolar.b;
	#else
		vec2 anisotropyV = anisotropyVector;
	#endif
	material.anisotropy = length( anisotropyV );
	if( material.anisotropy == 0.0 ) {
		anisotropyV = vec2( 1.0, 0.0 );
	} else {
		anisotropyV /= material.anisotropy;
		material.anisotropy = saturate( material.anisotropy );
	}
	material.alphaT = mix( pow2( material.roughness ), 1.0, pow2( material.anisotropy ) );
	material.anisotropyT = tbn[ 0 ] * anisotropyV.x + tbn[ 1 ] * anisotropyV.y;
	material.anisotropyB = tbn[ 1 ] * anisotropyV.x - tbn[ 0 ] * anisotropyV.y;
#endif`,ly=`uniform sampler2D dfgLUT;
struct PhysicalMaterial {
	vec3 diffuseColor;
	vec3 diffuseContribution;
	vec3 specularColor;
	vec3 specularColorBlended;
	float roughness;
	float metalness;
	float specularF90;
	float dispersion;
	vec2 dfg;
	vec3 multiScatteringCompensation;
	#ifdef USE_DIFFUSE_ROUGHNESS
		float diffuseRoughness;
	#endif
	#ifdef USE_RETROREFLECTION
		float retroreflectivity;
	#endif
	#ifdef USE_CLEARCOAT
		float clearcoat;
		float clearcoatRoughness;
		vec3 clearcoatF0;
		float clearcoatF90;
	#endif
	#ifdef USE_IRIDESCENCE
		float iridescence;
		float iridescenceIOR;
		float iridescenceThickness;
		vec3 iridescenceFresnel;
		vec3 iridescenceF0Dielectric;
		vec3 iridescenceF0Metallic;
	#endif
	#ifdef USE_SHEEN
		vec3 sheenColor;
		float sheenRoughness;
	#endif
	#ifdef IOR
		float ior;
	#endif
	#ifdef USE_TRANSMISSION
		float transmission;
		float transmissionAlpha;
		float thickness;
		float attenuationDistance;
		vec3 attenuationColor;
	#endif
	#ifdef USE_ANISOTROPY
		float anisotropy;
		float alphaT;
		vec3 anisotropyT;
		vec3 anisotropyB;
	#endif
};
vec3 clearcoatSpecularDirect = vec3( 0.0 );
vec3 clearcoatSpecularIndirect = vec3( 0.0 );
vec3 sheenSpecularDirect = vec3( 0.0 );
vec3 sheenSpecularIndirect = vec3(0.0 );
vec3 Schlick_to_F0( const in vec3 f, const in float f90, const in float dotVH ) {
    float x = clamp( 1.0 - dotVH, 0.0, 1.0 );
    float x2 = x * x;
    float x5 = clamp( x * x2 * x2, 0.0, 0.9999 );
    return ( f - vec3( f90 ) * x5 ) / ( 1.0 - x5 );
}
#ifdef USE_DIFFUSE_ROUGHNESS
	const float EON_EPSILON = 1e-7;
	float FON_DirectionalAlbedo( const in float mu, const in float roughness, const in float A ) {
		float muComp = 1.0 - mu;
		float gOverPi = muComp * ( 0.0571085289 + muComp * ( 0.491881867 + muComp * ( - 0.332181442 + muComp * 0.0714429953 ) ) );
		return A * ( 1.0 + roughness * gOverPi );
	}
	vec3 BRDF_EON( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in vec3 diffuseColor, const in float roughness ) {
		vec3 rho = saturate( diffuseColor );
		if ( roughness <= EON_EPSILON ) return BRDF_Lambert( rho );
		float dotNL = saturate( dot( normal, lightDir ) );
		float dotNV = saturate( dot( normal, viewDir ) );
		float s = dot( lightDir, viewDir ) - dotNL * dotNV;
		float sOverT = ( s > 0.0 ) ? s / max( max( dotNL, dotNV ), EON_EPSILON ) : s;
		float A = 1.0 / ( 1.0 + ( 0.5 - 2.0 / ( 3.0 * PI ) ) * roughness );
		vec3 singleScatter = rho * RECIPROCAL_PI * A * ( 1.0 + roughness * sOverT );
		float averageAlbedo = A * ( 1.0 + ( 2.0 / 3.0 - 28.0 / ( 15.0 * PI ) ) * roughness );
		float albedoV = FON_DirectionalAlbedo( dotNV, roughness, A );
		float albedoL = FON_DirectionalAlbedo( dotNL, roughness, A );
		vec3 rhoMultiScatter = rho * rho * averageAlbedo / max( vec3( EON_EPSILON ), vec3( 1.0 ) - rho * ( 1.0 - averageAlbedo ) );
		vec3 multiScatter = rhoMultiScatter * RECIPROCAL_PI
			* max( EON_EPSILON, 1.0 - albedoV )
			* max( EON_EPSILON, 1.0 - albedoL )
			/ max( EON_EPSILON, 1.0 - averageAlbedo );
		return singleScatter + multiScatter;
	}
	vec3 EON_DirectionalAlbedo( const in vec3 diffuseColor, const in float roughness, const in float dotNV ) {
		vec3 rho = saturate( diffuseColor );
		if ( roughness <= EON_EPSILON ) return rho;
		float A = 1.0 / ( 1.0 + ( 0.5 - 2.0 / ( 3.0 * PI ) ) * roughness );
		float directionalAlbedo = FON_DirectionalAlbedo( dotNV, roughness, A );
		float averageAlbedo = A * ( 1.0 + ( 2.0 / 3.0 - 28.0 / ( 15.0 * PI ) ) * roughness );
		vec3 rhoMultiScatter = rho * rho * averageAlbedo / max( vec3( EON_EPSILON ), vec3( 1.0 ) - rho * ( 1.0 - averageAlbedo ) );
		return rho * directionalAlbedo + rhoMultiScatter * ( 1.0 - directionalAlbedo );
	}
#endif
float V_GGX_SmithCorrelated( const in float alpha, const in float dotNL, const in float dotNV ) {
	float a2 = pow2( alpha );
	float gv = dotNL * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNV ) );
	float gl = dotNV * sqrt( a2 + ( 1.0 - a2 ) * pow2( dotNL ) );
	return 0.5 / max( gv + gl, EPSILON );
}
float D_GGX( const in float alpha, const in float dotNH ) {
	float a2 = pow2( alpha );
	float denom = pow2( dotNH ) * ( a2 - 1.0 ) + 1.0;
	return RECIPROCAL_PI * a2 / pow2( denom );
}
#ifdef USE_ANISOTROPY
	float V_GGX_SmithCorrelated_Anisotropic( const in float alphaT, const in float alphaB, const in float dotTV, const in float dotBV, const in float dotTL, const in float dotBL, const in float dotNV, const in float dotNL ) {
		float gv = dotNL * length( vec3( alphaT * dotTV, alphaB * dotBV, dotNV ) );
		float gl = dotNV * length( vec3( alphaT * dotTL, alphaB * dotBL, dotNL ) );
		return 0.5 / max( gv + gl, EPSILON );
	}
	float D_GGX_Anisotropic( const in float alphaT, const in float alphaB, const in float dotNH, const in float dotTH, const in float dotBH ) {
		float a2 = alphaT * alphaB;
		highp vec3 v = vec3( alphaB * dotTH, alphaT * dotBH, a2 * dotNH );
		highp float v2 = dot( v, v );
		float w2 = a2 / v2;
		return RECIPROCAL_PI * a2 * pow2 ( w2 );
	}
#endif
#ifdef USE_CLEARCOAT
	vec3 BRDF_GGX_Clearcoat( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material) {
		vec3 f0 = material.clearcoatF0;
		float f90 = material.clearcoatF90;
		float roughness = max( material.clearcoatRoughness, 0.045 );
		float alpha = pow2( roughness );
		vec3 halfDir = normalize( lightDir + viewDir );
		float dotNL = saturate( dot( normal, lightDir ) );
		float dotNV = saturate( dot( normal, viewDir ) );
		float dotNH = saturate( dot( normal, halfDir ) );
		float dotVH = saturate( dot( viewDir, halfDir ) );
		vec3 F = F_Schlick( f0, f90, dotVH );
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
		return F * ( V * D );
	}
#endif
vec3 BRDF_GGX( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, const in PhysicalMaterial material ) {
	vec3 f0 = material.specularColorBlended;
	float f90 = material.specularF90;
	float roughness = max( material.roughness, 0.045 );
	float alpha = pow2( roughness );
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float dotVH = saturate( dot( viewDir, halfDir ) );
	vec3 F = F_Schlick( f0, f90, dotVH );
	#ifdef USE_IRIDESCENCE
		F = mix( F, material.iridescenceFresnel, material.iridescence );
	#endif
	#ifdef USE_ANISOTROPY
		float dotTL = dot( material.anisotropyT, lightDir );
		float dotTV = dot( material.anisotropyT, viewDir );
		float dotTH = dot( material.anisotropyT, halfDir );
		float dotBL = dot( material.anisotropyB, lightDir );
		float dotBV = dot( material.anisotropyB, viewDir );
		float dotBH = dot( material.anisotropyB, halfDir );
		float alphaT = max( material.alphaT, alpha );
		float V = V_GGX_SmithCorrelated_Anisotropic( alphaT, alpha, dotTV, dotBV, dotTL, dotBL, dotNV, dotNL );
		float D = D_GGX_Anisotropic( alphaT, alpha, dotNH, dotTH, dotBH );
	#else
		float V = V_GGX_SmithCorrelated( alpha, dotNL, dotNV );
		float D = D_GGX( alpha, dotNH );
	#endif
	return F * ( V * D );
}
vec2 LTC_Uv( const in vec3 N, const in vec3 V, const in float roughness ) {
	const float LUT_SIZE = 64.0;
	const float LUT_SCALE = ( LUT_SIZE - 1.0 ) / LUT_SIZE;
	const float LUT_BIAS = 0.5 / LUT_SIZE;
	float dotNV = saturate( dot( N, V ) );
	vec2 uv = vec2( roughness, sqrt( 1.0 - dotNV ) );
	uv = uv * LUT_SCALE + LUT_BIAS;
	return uv;
}
float LTC_ClippedSphereFormFactor( const in vec3 f ) {
	float l = length( f );
	return max( ( l * l + f.z ) / ( l + 1.0 ), 0.0 );
}
vec3 LTC_EdgeVectorFormFactor( const in vec3 v1, const in vec3 v2 ) {
	float x = dot( v1, v2 );
	float y = abs( x );
	float a = 0.8543985 + ( 0.4965155 + 0.0145206 * y ) * y;
	float b = 3.4175940 + ( 4.1616724 + y ) * y;
	float v = a / b;
	float theta_sintheta = ( x > 0.0 ) ? v : 0.5 * inversesqrt( max( 1.0 - x * x, 1e-7 ) ) - v;
	return cross( v1, v2 ) * theta_sintheta;
}
vec3 LTC_Evaluate( const in vec3 N, const in vec3 V, const in vec3 P, const in mat3 mInv, const in vec3 rectCoords[ 4 ] ) {
	vec3 v1 = rectCoords[ 1 ] - rectCoords[ 0 ];
	vec3 v2 = rectCoords[ 3 ] - rectCoords[ 0 ];
	vec3 lightNormal = cross( v1, v2 );
	if( dot( lightNormal, P - rectCoords[ 0 ] ) < 0.0 ) return vec3( 0.0 );
	vec3 T1, T2;
	T1 = normalize( V - N * dot( V, N ) );
	T2 = - cross( N, T1 );
	mat3 mat = mInv * transpose( mat3( T1, T2, N ) );
	vec3 coords[ 4 ];
	coords[ 0 ] = mat * ( rectCoords[ 0 ] - P );
	coords[ 1 ] = mat * ( rectCoords[ 1 ] - P );
	coords[ 2 ] = mat * ( rectCoords[ 2 ] - P );
	coords[ 3 ] = mat * ( rectCoords[ 3 ] - P );
	coords[ 0 ] = normalize( coords[ 0 ] );
	coords[ 1 ] = normalize( coords[ 1 ] );
	coords[ 2 ] = normalize( coords[ 2 ] );
	coords[ 3 ] = normalize( coords[ 3 ] );
	vec3 vectorFormFactor = vec3( 0.0 );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 0 ], coords[ 1 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 1 ], coords[ 2 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 2 ], coords[ 3 ] );
	vectorFormFactor += LTC_EdgeVectorFormFactor( coords[ 3 ], coords[ 0 ] );
	float result = LTC_ClippedSphereFormFactor( vectorFormFactor );
	return vec3( result );
}
#if defined( USE_SHEEN )
float D_Charlie( float roughness, float dotNH ) {
	float alpha = pow2( roughness );
	float invAlpha = 1.0 / alpha;
	float cos2h = dotNH * dotNH;
	float sin2h = max( 1.0 - cos2h, 0.0078125 );
	return ( 2.0 + invAlpha ) * pow( sin2h, invAlpha * 0.5 ) / ( 2.0 * PI );
}
float V_Neubelt( float dotNV, float dotNL ) {
	return saturate( 1.0 / ( 4.0 * ( dotNL + dotNV - dotNL * dotNV ) ) );
}
vec3 BRDF_Sheen( const in vec3 lightDir, const in vec3 viewDir, const in vec3 normal, vec3 sheenColor, const in float sheenRoughness ) {
	vec3 halfDir = normalize( lightDir + viewDir );
	float dotNL = saturate( dot( normal, lightDir ) );
	float dotNV = saturate( dot( normal, viewDir ) );
	float dotNH = saturate( dot( normal, halfDir ) );
	float D = D_Charlie( sheenRoughness, dotNH );
	float V = V_Neubelt( dotNV, dotNL );
	return sheenColor * ( D * V );
}
#endif
float IBLSheenBRDF( const in vec3 normal, const in vec3 viewDir, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	float r2 = roughness * roughness;
	float rInv = 1.0 / ( roughness + 0.1 );
	float a = -1.9362 + 1.0678 * roughness + 0.4573 * r2 - 0.8469 * rInv;
	float b = -0.6014 + 0.5538 * roughness - 0.4670 * r2 - 0.1255 * rInv;
	float DG = exp( a * dotNV + b );
	return saturate( DG );
}
vec3 EnvironmentBRDF( const in vec3 normal, const in vec3 viewDir, const in vec3 specularColor, const in float specularF90, const in float roughness ) {
	float dotNV = saturate( dot( normal, viewDir ) );
	vec2 fab = texture2D( dfgLUT, vec2( roughness, dotNV ) ).rg;
	return specularColor * fab.x + specularF90 * fab.y;
}
#ifdef USE_IRIDESCENCE
void computeMultiscatteringIridescence( const in vec2 fab, const in vec3 specularColor, const in float specularF90, const in float iridescence, const in vec3 iridescenceF0, inout vec3 singleScatter, inout vec3 multiScatter ) {
#else
void computeMultiscattering( const in vec2 fab, const in vec3 specularColor, const in float specularF90, inout vec3 singleScatter, inout vec3 multiScatter ) {
#endif
	#ifdef USE_IRIDESCENCE
		vec3 Fr = mix( specularColor, iridescenceF0, iridescence );
	#else
		vec3 Fr = specularColor;
	#endif
	vec3 FssEss = Fr * fab.x + specularF90 * fab.y;
	float Ess = fab.x + fab.y;
	float Ems = 1.0 - Ess;
	vec3 Favg = Fr + ( 1.0 - Fr ) * 0.047619;	vec3 Fms = FssEss * Favg / ( 1.0 - Ems * Favg );
	singleScatter += FssEss;
	multiScatter += Fms * Ems;
}
#if NUM_RECT_AREA_LIGHTS > 0
	void RE_Direct_RectArea_Physical( const in RectAreaLight rectAreaLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
		vec3 normal = geometryNormal;
		vec3 viewDir = geometryViewDir;
		vec3 position = geometryPosition;
		vec3 lightPos = rectAreaLight.position;
		vec3 halfWidth = rectAreaLight.halfWidth;
		vec3 halfHeight = rectAreaLight.halfHeight;
		vec3 lightColor = rectAreaLight.color;
		float roughness = material.roughness;
		vec3 rectCoords[ 4 ];
		rectCoords[ 0 ] = lightPos + halfWidth - halfHeight;		rectCoords[ 1 ] = lightPos - halfWidth - halfHeight;
		rectCoords[ 2 ] = lightPos - halfWidth + halfHeight;
		rectCoords[ 3 ] = lightPos + halfWidth + halfHeight;
		vec2 uv = LTC_Uv( normal, viewDir, roughness );
		vec4 t1 = texture2D( ltc_1, uv );
		vec4 t2 = texture2D( ltc_2, uv );
		mat3 mInv = mat3(
			vec3( t1.x, 0, t1.y ),
			vec3(    0, 1,    0 ),
			vec3( t1.z, 0, t1.w )
		);
		vec3 fresnel = ( material.specularColorBlended * t2.x + ( material.specularF90 - material.specularColorBlended ) * t2.y );
		reflectedLight.directSpecular += lightColor * fresnel * LTC_Evaluate( normal, viewDir, position, mInv, rectCoords );
		reflectedLight.directDiffuse += lightColor * material.diffuseContribution * LTC_Evaluate( normal, viewDir, position, mat3( 1.0 ), rectCoords );
		#ifdef USE_CLEARCOAT
			vec3 Ncc = geometryClearcoatNormal;
			vec2 uvClearcoat = LTC_Uv( Ncc, viewDir, material.clearcoatRoughness );
			vec4 t1Clearcoat = texture2D( ltc_1, uvClearcoat );
			vec4 t2Clearcoat = texture2D( ltc_2, uvClearcoat );
			mat3 mInvClearcoat = mat3(
				vec3( t1Clearcoat.x, 0, t1Clearcoat.y ),
				vec3(             0, 1,             0 ),
				vec3( t1Clearcoat.z, 0, t1Clearcoat.w )
			);
			vec3 fresnelClearcoat = material.clearcoatF0 * t2Clearcoat.x + ( material.clearcoatF90 - material.clearcoatF0 ) * t2Clearcoat.y;
			clearcoatSpecularDirect += lightColor * fresnelClearcoat * LTC_Evaluate( Ncc, viewDir, position, mInvClearcoat, rectCoords );
		#endif
	}
#endif
void RE_Direct_Physical( const in IncidentLight directLight, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	float dotNL = saturate( dot( geometryNormal, directLight.direction ) );
	vec3 irradiance = dotNL * directLight.color;
	#ifdef USE_CLEARCOAT
		float dotNLcc = saturate( dot( geometryClearcoatNormal, directLight.direction ) );
		vec3 ccIrradiance = dotNLcc * directLight.color;
		clearcoatSpecularDirect += ccIrradiance * BRDF_GGX_Clearcoat( directLight.direction, geometryViewDir, geometryClearcoatNormal, material );
	#endif
	#ifdef USE_SHEEN
 
 		sheenSpecularDirect += irradiance * BRDF_Sheen( directLight.direction, geometryViewDir, geometryNormal, material.sheenColor, material.sheenRoughness );
 
 		float sheenAlbedoV = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
 		float sheenAlbedoL = IBLSheenBRDF( geometryNormal, directLight.direction, material.sheenRoughness );
 
 		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * max( sheenAlbedoV, sheenAlbedoL );
 
 		irradiance *= sheenEnergyComp;
 
 	#endif
	vec3 specularBRDF = BRDF_GGX( directLight.direction, geometryViewDir, geometryNormal, material );
	#ifdef USE_RETROREFLECTION
		vec3 retroViewDir = reflect( - geometryViewDir, geometryNormal );
		vec3 retroSpecularBRDF = BRDF_GGX( directLight.direction, retroViewDir, geometryNormal, material );
		specularBRDF = mix( specularBRDF, retroSpecularBRDF, saturate( material.retroreflectivity ) );
	#endif
	reflectedLight.directSpecular += irradiance * specularBRDF * material.multiScatteringCompensation;
	vec3 halfDir = normalize( directLight.direction + geometryViewDir );
	float dotVH = saturate( dot( geometryViewDir, halfDir ) );
	vec3 F = F_Schlick( material.specularColor, material.specularF90, dotVH );
	#ifdef USE_RETROREFLECTION
		vec3 retroHalfDir = normalize( directLight.direction + retroViewDir );
		float dotRetroVH = saturate( dot( retroViewDir, retroHalfDir ) );
		vec3 retroF = F_Schlick( material.specularColor, material.specularF90, dotRetroVH );
		F = mix( F, retroF, saturate( material.retroreflectivity ) );
	#endif
	#ifdef USE_DIFFUSE_ROUGHNESS
		vec3 diffuseBRDF = BRDF_EON( directLight.direction, geometryViewDir, geometryNormal, material.diffuseColor, material.diffuseRoughness ) * ( 1.0 - material.metalness );
	#else
		vec3 diffuseBRDF = BRDF_Lambert( material.diffuseContribution );
	#endif
	reflectedLight.directDiffuse += irradiance * diffuseBRDF * ( 1.0 - F );
}
void RE_IndirectDiffuse_Physical( const in vec3 irradiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight ) {
	vec3 singleScattering = vec3( 0.0 );
	vec3 multiScattering = vec3( 0.0 );
	#ifdef USE_IRIDESCENCE
		computeMultiscatteringIridescence( material.dfg, material.specularColor, material.specularF90, material.iridescence, material.iridescenceF0Dielectric, singleScattering, multiScattering );
	#else
		computeMultiscattering( material.dfg, material.specularColor, material.specularF90, singleScattering, multiScattering );
	#endif
	#ifdef USE_DIFFUSE_ROUGHNESS
		float dotNV = saturate( dot( geometryNormal, geometryViewDir ) );
		vec3 diffuseAlbedo = EON_DirectionalAlbedo( material.diffuseColor, material.diffuseRoughness, dotNV ) * ( 1.0 - material.metalness );
		vec3 diffuse = irradiance * RECIPROCAL_PI * diffuseAlbedo * ( 1.0 - singleScattering - multiScattering );
	#else
		vec3 diffuse = irradiance * BRDF_Lambert( material.diffuseContribution ) * ( 1.0 - singleScattering - multiScattering );
	#endif
	#ifdef USE_SHEEN
		float sheenAlbedo = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
		sheenSpecularIndirect += irradiance * material.sheenColor * sheenAlbedo * RECIPROCAL_PI;
		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * sheenAlbedo;
		diffuse *= sheenEnergyComp;
	#endif
	reflectedLight.indirectDiffuse += diffuse;
}
void RE_IndirectSpecular_Physical( const in vec3 radiance, const in vec3 irradiance, const in vec3 clearcoatRadiance, const in vec3 geometryPosition, const in vec3 geometryNormal, const in vec3 geometryViewDir, const in vec3 geometryClearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight) {
	#ifdef USE_CLEARCOAT
		clearcoatSpecularIndirect += clearcoatRadiance * EnvironmentBRDF( geometryClearcoatNormal, geometryViewDir, material.clearcoatF0, material.clearcoatF90, material.clearcoatRoughness );
	#endif
	#ifdef USE_SHEEN
		sheenSpecularIndirect += irradiance * material.sheenColor * IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness ) * RECIPROCAL_PI;
 	#endif
	vec3 singleScatteringDielectric = vec3( 0.0 );
	vec3 multiScatteringDielectric = vec3( 0.0 );
	vec3 singleScatteringMetallic = vec3( 0.0 );
	vec3 multiScatteringMetallic = vec3( 0.0 );
	#ifdef USE_IRIDESCENCE
		computeMultiscatteringIridescence( material.dfg, material.specularColor, material.specularF90, material.iridescence, material.iridescenceF0Dielectric, singleScatteringDielectric, multiScatteringDielectric );
		computeMultiscatteringIridescence( material.dfg, material.diffuseColor, material.specularF90, material.iridescence, material.iridescenceF0Metallic, singleScatteringMetallic, multiScatteringMetallic );
	#else
		computeMultiscattering( material.dfg, material.specularColor, material.specularF90, singleScatteringDielectric, multiScatteringDielectric );
		computeMultiscattering( material.dfg, material.diffuseColor, material.specularF90, singleScatteringMetallic, multiScatteringMetallic );
	#endif
	vec3 singleScattering = mix( singleScatteringDielectric, singleScatteringMetallic, material.metalness );
	vec3 multiScattering = mix( multiScatteringDielectric, multiScatteringMetallic, material.metalness );
	vec3 totalScatteringDielectric = singleScatteringDielectric + multiScatteringDielectric;
	#ifdef USE_DIFFUSE_ROUGHNESS
		float dotNV = saturate( dot( geometryNormal, geometryViewDir ) );
		vec3 diffuse = EON_DirectionalAlbedo( material.diffuseColor, material.diffuseRoughness, dotNV ) * ( 1.0 - material.metalness ) * ( 1.0 - totalScatteringDielectric );
	#else
		vec3 diffuse = material.diffuseContribution * ( 1.0 - totalScatteringDielectric );
	#endif
	vec3 cosineWeightedIrradiance = irradiance * RECIPROCAL_PI;
	vec3 indirectSpecular = radiance * singleScattering;
	indirectSpecular += multiScattering * cosineWeightedIrradiance;
	vec3 indirectDiffuse = diffuse * cosineWeightedIrradiance;
	#ifdef USE_SHEEN
		float sheenAlbedo = IBLSheenBRDF( geometryNormal, geometryViewDir, material.sheenRoughness );
		float sheenEnergyComp = 1.0 - max3( material.sheenColor ) * sheenAlbedo;
		indirectSpecular *= sheenEnergyComp;
		indirectDiffuse *= sheenEnergyComp;
	#endif
	reflectedLight.indirectSpecular += indirectSpecular;
	reflectedLight.indirectDiffuse += indirectDiffuse;
}
#define RE_Direct				RE_Direct_Physical
#define RE_Direct_RectArea		RE_Direct_RectArea_Physical
#define RE_IndirectDiffuse		RE_IndirectDiffuse_Physical
#define RE_IndirectSpecular		RE_IndirectSpecular_Physical
float computeSpecularOcclusion( const in float dotNV, const in float ambientOcclusion, const in float roughness ) {
	return saturate( pow( dotNV + ambientOcclusion, exp2( - 16.0 * roughness - 1.0 ) ) - 1.0 + ambientOcclusion );
}`,cy=`
vec3 geometryPosition = - vViewPosition;
vec3 geometryNormal = normal;
vec3 geometryViewDir = ( isOrthographic ) ? vec3( 0, 0, 1 ) : normalize( vViewPosition );
vec3 geometryClearcoatNormal = vec3( 0.0 );
#ifdef USE_CLEARCOAT
	geometryClearcoatNormal = clearcoatNormal;
#endif
#ifdef USE_IRIDESCENCE
	float dotNVi = saturate( dot( normal, geometryViewDir ) );
	if ( material.iridescenceThickness == 0.0 ) {
		material.iridescence = 0.0;
	} else {
		material.iridescence = saturate( material.iridescence );
	}
	if ( material.iridescence > 0.0 ) {
		vec3 iridescenceFresnelDielectric = evalIridescence( 1.0, material.iridescenceIOR, dotNVi, material.iridescenceThickness, material.specularColor );
		vec3 iridescenceFresnelMetallic = evalIridescence( 1.0, material.iridescenceIOR, dotNVi, material.iridescenceThickness, material.diffuseColor );
		material.iridescenceFresnel = mix( iridescenceFresnelDielectric, iridescenceFresnelMetallic, material.metalness );
		material.iridescenceF0Dielectric = Schlick_to_F0( iridescenceFresnelDielectric, 1.0, dotNVi );
		material.iridescenceF0Metallic = Schlick_to_F0( iridescenceFresnelMetallic, 1.0, dotNVi );
	}
#endif
#ifdef STANDARD
	float dotNVms = saturate( dot( geometryNormal, geometryViewDir ) );
	material.dfg = texture2D( dfgLUT, vec2( material.roughness, dotNVms ) ).rg;
	#if ( NUM_SUN_LIGHTS > 0 || NUM_DIR_LIGHTS > 0 || NUM_POINT_LIGHTS > 0 || NUM_SPOT_LIGHTS > 0 )
		float EssMs = material.dfg.x + material.dfg.y;
		material.multiScatteringCompensation = 1.0 + material.specularColorBlended * ( 1.0 / EssMs - 1.0 );
	#endif
#endif
IncidentLight directLight;
#if ( NUM_POINT_LIGHTS > 0 ) && defined( RE_Direct )
	PointLight pointLight;
	#if defined( USE_SHADOWMAP ) && NUM_POINT_LIGHT_SHADOWS > 0
	PointLightShadow pointLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHTS; i ++ ) {
		pointLight = pointLights[ i ];
		getPointLightInfo( pointLight, geometryPosition, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_POINT_LIGHT_SHADOWS ) && ( defined( SHADOWMAP_TYPE_PCF ) || defined( SHADOWMAP_TYPE_BASIC ) )
		pointLightShadow = pointLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getPointShadow( pointShadowMap[ i ], pointLightShadow.shadowMapSize, pointLightShadow.shadowIntensity, pointLightShadow.shadowBias, pointLightShadow.shadowRadius, vPointShadowCoord[ i ], pointLightShadow.shadowCameraNear, pointLightShadow.shadowCameraFar ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_SPOT_LIGHTS > 0 ) && defined( RE_Direct )
	SpotLight spotLight;
	vec4 spotColor;
	vec3 spotLightCoord;
	bool inSpotLightMap;
	#if defined( USE_SHADOWMAP ) && NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHTS; i ++ ) {
		spotLight = spotLights[ i ];
		getSpotLightInfo( spotLight, geometryPosition, directLight );
		#if ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#define SPOT_LIGHT_MAP_INDEX UNROLLED_LOOP_INDEX
		#elif ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		#define SPOT_LIGHT_MAP_INDEX NUM_SPOT_LIGHT_MAPS
		#else
		#define SPOT_LIGHT_MAP_INDEX ( UNROLLED_LOOP_INDEX - NUM_SPOT_LIGHT_SHADOWS + NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS )
		#endif
		#if ( SPOT_LIGHT_MAP_INDEX < NUM_SPOT_LIGHT_MAPS )
			spotLightCoord = vSpotLightCoord[ i ].xyz / vSpotLightCoord[ i ].w;
			inSpotLightMap = all( lessThan( abs( spotLightCoord * 2. - 1. ), vec3( 1.0 ) ) );
			spotColor = texture2D( spotLightMap[ SPOT_LIGHT_MAP_INDEX ], spotLightCoord.xy );
			directLight.color = inSpotLightMap ? directLight.color * spotColor.rgb : directLight.color;
		#endif
		#undef SPOT_LIGHT_MAP_INDEX
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
		spotLightShadow = spotLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( spotShadowMap[ i ], spotLightShadow.shadowMapSize, spotLightShadow.shadowIntensity, spotLightShadow.shadowBias, spotLightShadow.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_SUN_LIGHTS > 0 ) && defined( RE_Direct )
	SunLight sunLight;
	#if defined( USE_SHADOWMAP ) && NUM_SUN_LIGHT_SHADOWS > 0
	SunLightShadow sunLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SUN_LIGHTS; i ++ ) {
		sunLight = sunLights[ i ];
		getSunLightInfo( sunLight, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_SUN_LIGHT_SHADOWS )
		sunLightShadow = sunLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getSunShadow( sunShadowMap[ i ], sunLightShadow, UNROLLED_LOOP_INDEX ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_DIR_LIGHTS > 0 ) && defined( RE_Direct )
	DirectionalLight directionalLight;
	#if defined( USE_SHADOWMAP ) && NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLightShadow;
	#endif
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHTS; i ++ ) {
		directionalLight = directionalLights[ i ];
		getDirectionalLightInfo( directionalLight, directLight );
		#if defined( USE_SHADOWMAP ) && ( UNROLLED_LOOP_INDEX < NUM_DIR_LIGHT_SHADOWS )
		directionalLightShadow = directionalLightShadows[ i ];
		directLight.color *= ( directLight.visible && receiveShadow ) ? getShadow( directionalShadowMap[ i ], directionalLightShadow.shadowMapSize, directionalLightShadow.shadowIntensity, directionalLightShadow.shadowBias, directionalLightShadow.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
		#endif
		RE_Direct( directLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if ( NUM_RECT_AREA_LIGHTS > 0 ) && defined( RE_Direct_RectArea )
	RectAreaLight rectAreaLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_RECT_AREA_LIGHTS; i ++ ) {
		rectAreaLight = rectAreaLights[ i ];
		RE_Direct_RectArea( rectAreaLight, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
	}
	#pragma unroll_loop_end
#endif
#if defined( RE_IndirectDiffuse )
	vec3 iblIrradiance = vec3( 0.0 );
	vec3 irradiance = getAmbientLightIrradiance( ambientLightColor );
	#if defined( USE_LIGHT_PROBES )
		irradiance += getLightProbeIrradiance( lightProbe, geometryNormal );
	#endif
	#if ( NUM_HEMI_LIGHTS > 0 )
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_HEMI_LIGHTS; i ++ ) {
			irradiance += getHemisphereLightIrradiance( hemisphereLights[ i ], geometryNormal );
		}
		#pragma unroll_loop_end
	#endif
	#if NUM_LIGHT_PROBE_GRIDS > 0
		vec3 probeWorldPos = ( ( vec4( geometryPosition, 1.0 ) - viewMatrix[ 3 ] ) * viewMatrix ).xyz;
		vec3 probeWorldNormal = transformNormalByInverseViewMatrix( geometryNormal, viewMatrix );
		int probeGrid = - 1;
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_LIGHT_PROBE_GRIDS; i ++ ) {
			if ( isInsideLightProbeGrid( probeWorldPos, probeWorldNormal, probesMin[ i ], probesMax[ i ], probesResolution[ i ] ) ) probeGrid = UNROLLED_LOOP_INDEX;
		}
		#pragma unroll_loop_end
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_LIGHT_PROBE_GRIDS; i ++ ) {
			if ( probeGrid == UNROLLED_LOOP_INDEX ) irradiance += getLightProbeGridIrradiance( probesSH[ i ], probesMin[ i ], probesMax[ i ], probesResolution[ i ], probeWorldPos, probeWorldNormal );
		}
		#pragma unroll_loop_end
	#endif
#endif
#if defined( RE_IndirectSpecular )
	vec3 radiance = vec3( 0.0 );
	vec3 clearcoatRadiance = vec3( 0.0 );
#endif`,hy=`#if defined( RE_IndirectDiffuse )
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		vec3 lightMapIrradiance = lightMapTexel.rgb * lightMapIntensity;
		irradiance += lightMapIrradiance;
	#endif
	#if defined( USE_ENVMAP ) && defined( ENVMAP_TYPE_PMREM )
		#if defined( STANDARD ) || defined( LAMBERT ) || defined( PHONG )
			iblIrradiance += getIBLIrradiance( geometryNormal );
		#endif
	#endif
#endif
#if defined( USE_ENVMAP ) && defined( RE_IndirectSpecular )
	#ifdef USE_ANISOTROPY
		vec3 iblRadiance = getIBLAnisotropyRadiance( geometryViewDir, geometryNormal, material.roughness, material.anisotropyB, material.anisotropy );
	#else
		vec3 iblRadiance = getIBLRadiance( geometryViewDir, geometryNormal, material.roughness );
	#endif
	#ifdef USE_RETROREFLECTION
		#ifdef USE_ANISOTROPY
			vec3 retroIBLRadiance = getIBLAnisotropyRetroRadiance( geometryViewDir, geometryNormal, material.roughness, material.anisotropyB, material.anisotropy );
		#else
			vec3 retroIBLRadiance = getIBLRetroRadiance( geometryViewDir, geometryNormal, material.roughness );
		#endif
		iblRadiance = mix( iblRadiance, retroIBLRadiance, saturate( material.retroreflectivity ) );
	#endif
	radiance += iblRadiance;
	#ifdef USE_CLEARCOAT
		clearcoatRadiance += getIBLRadiance( geometryViewDir, geometryClearcoatNormal, material.clearcoatRoughness );
	#endif
#endif`,uy=`#if defined( RE_IndirectDiffuse )
	#if defined( LAMBERT ) || defined( PHONG )
		irradiance += iblIrradiance;
	#endif
	RE_IndirectDiffuse( irradiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif
#if defined( RE_IndirectSpecular )
	RE_IndirectSpecular( radiance, iblIrradiance, clearcoatRadiance, geometryPosition, geometryNormal, geometryViewDir, geometryClearcoatNormal, material, reflectedLight );
#endif`,dy=`#if NUM_LIGHT_PROBE_GRIDS > 0
uniform highp sampler3D probesSH[ NUM_LIGHT_PROBE_GRIDS ];
uniform vec3 probesMin[ NUM_LIGHT_PROBE_GRIDS ];
uniform vec3 probesMax[ NUM_LIGHT_PROBE_GRIDS ];
uniform vec3 probesResolution[ NUM_LIGHT_PROBE_GRIDS ];
bool isInsideLightProbeGrid( vec3 worldPos, vec3 worldNormal, vec3 probesMin, vec3 probesMax, vec3 probesResolution ) {
	vec3 spacing = ( probesMax - probesMin ) / probesResolution;
	vec3 samplePos = worldPos + worldNormal * spacing * 0.5;
	vec3 margin = spacing * 0.01;
	return all( greaterThanEqual( samplePos, probesMin - margin ) ) && all( lessThanEqual( samplePos, probesMax + margin ) );
}
vec3 getLightProbeGridIrradiance( highp sampler3D probesSH, vec3 probesMin, vec3 probesMax, vec3 probesResolution, vec3 worldPos, vec3 worldNormal ) {
	vec3 res = probesResolution;
	vec3 gridRange = probesMax - probesMin;
	vec3 probeSpacing = gridRange / res;
	vec3 samplePos = worldPos + worldNormal * probeSpacing * 0.5;
	vec3 uvw = clamp( ( samplePos - probesMin ) / gridRange, 0.5 / res, 1.0 - 0.5 / res );
	float nz          = res.z;
	float paddedSlices = nz + 2.0;
	float atlasDepth  = 7.0 * paddedSlices;
	float uvZBase     = uvw.z * nz + 1.0;
	vec4 s0 = texture( probesSH, vec3( uvw.xy, ( uvZBase                       ) / atlasDepth ) );
	vec4 s1 = texture( probesSH, vec3( uvw.xy, ( uvZBase +       paddedSlices   ) / atlasDepth ) );
	vec4 s2 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 2.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s3 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 3.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s4 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 4.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s5 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 5.0 * paddedSlices   ) / atlasDepth ) );
	vec4 s6 = texture( probesSH, vec3( uvw.xy, ( uvZBase + 6.0 * paddedSlices   ) / atlasDepth ) );
	vec3 c0 = s0.xyz;
	vec3 c1 = vec3( s0.w, s1.xy );
	vec3 c2 = vec3( s1.zw, s2.x );
	vec3 c3 = s2.yzw;
	vec3 c4 = s3.xyz;
	vec3 c5 = vec3( s3.w, s4.xy );
	vec3 c6 = vec3( s4.zw, s5.x );
	vec3 c7 = s5.yzw;
	vec3 c8 = s6.xyz;
	float x = worldNormal.x, y = worldNormal.y, z = worldNormal.z;
	vec3 result = c0 * 0.886227;
	result += c1 * 2.0 * 0.511664 * y;
	result += c2 * 2.0 * 0.511664 * z;
	result += c3 * 2.0 * 0.511664 * x;
	result += c4 * 2.0 * 0.429043 * x * y;
	result += c5 * 2.0 * 0.429043 * y * z;
	result += c6 * ( 0.743125 * z * z - 0.247708 );
	result += c7 * 2.0 * 0.429043 * x * z;
	result += c8 * 0.429043 * ( x * x - y * y );
	return max( result, vec3( 0.0 ) );
}
#endif`,fy=`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	gl_FragDepth = vIsPerspective == 0.0 ? gl_FragCoord.z : log2( vFragDepth ) * logDepthBufFC * 0.5;
#endif`,py=`#if defined( USE_LOGARITHMIC_DEPTH_BUFFER )
	uniform float logDepthBufFC;
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,my=`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	varying float vFragDepth;
	varying float vIsPerspective;
#endif`,gy=`#ifdef USE_LOGARITHMIC_DEPTH_BUFFER
	vFragDepth = 1.0 + gl_Position.w;
	vIsPerspective = float( isPerspectiveMatrix( projectionMatrix ) );
#endif`,xy=`#ifdef USE_MAP
	vec4 sampledDiffuseColor = texture2D( map, vMapUv );
	#ifdef DECODE_VIDEO_TEXTURE
		sampledDiffuseColor = sRGBTransferEOTF( sampledDiffuseColor );
	#endif
	diffuseColor *= sampledDiffuseColor;
#endif`,yy=`#ifdef USE_MAP
	uniform sampler2D map;
#endif`,vy=`#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
	#if defined( USE_POINTS_UV )
		vec2 uv = vUv;
	#else
		vec2 uv = ( uvTransform * vec3( gl_PointCoord.x, 1.0 - gl_PointCoord.y, 1 ) ).xy;
	#endif
#endif
#ifdef USE_MAP
	diffuseColor *= texture2D( map, uv );
#endif
#ifdef USE_ALPHAMAP
	diffuseColor.a *= texture2D( alphaMap, uv ).g;
#endif`,_y=`#if defined( USE_POINTS_UV )
	varying vec2 vUv;
#else
	#if defined( USE_MAP ) || defined( USE_ALPHAMAP )
		uniform mat3 uvTransform;
	#endif
#endif
#ifdef USE_MAP
	uniform sampler2D map;
#endif
#ifdef USE_ALPHAMAP
	uniform sampler2D alphaMap;
#endif`,by=`float metalnessFactor = metalness;
#ifdef USE_METALNESSMAP
	vec4 texelMetalness = texture2D( metalnessMap, vMetalnessMapUv );
	metalnessFactor *= texelMetalness.b;
#endif`,My=`#ifdef USE_METALNESSMAP
	uniform sampler2D metalnessMap;
#endif`,wy=`#ifdef USE_INSTANCING_MORPH
	float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	float morphTargetBaseInfluence = texelFetch( morphTexture, ivec2( 0, gl_InstanceID ), 0 ).r;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		morphTargetInfluences[i] =  texelFetch( morphTexture, ivec2( i + 1, gl_InstanceID ), 0 ).r;
	}
#endif`,Sy=`#if defined( USE_MORPHCOLORS )
	#if defined( USE_COLOR_ALPHA )
		vColor *= morphTargetBaseInfluence;
	#elif defined( USE_COLOR )
		vColor.rgb *= morphTargetBaseInfluence;
	#endif
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		#if defined( USE_COLOR_ALPHA )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor += getMorph( gl_VertexID, i, 2 ) * morphTargetInfluences[ i ];
		#elif defined( USE_COLOR )
			if ( morphTargetInfluences[ i ] != 0.0 ) vColor.rgb += getMorph( gl_VertexID, i, 2 ).rgb * morphTargetInfluences[ i ];
		#endif
	}
#endif`,Ty=`#ifdef USE_MORPHNORMALS
	objectNormal *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) objectNormal += getMorph( gl_VertexID, i, 1 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,Ay=`#ifdef USE_MORPHTARGETS
	#ifndef USE_INSTANCING_MORPH
		uniform float morphTargetBaseInfluence;
		uniform float morphTargetInfluences[ MORPHTARGETS_COUNT ];
	#endif
	uniform sampler2DArray morphTargetsTexture;
	uniform ivec2 morphTargetsTextureSize;
	vec4 getMorph( const in int vertexIndex, const in int morphTargetIndex, const in int offset ) {
		int texelIndex = vertexIndex * MORPHTARGETS_TEXTURE_STRIDE + offset;
		int y = texelIndex / morphTargetsTextureSize.x;
		int x = texelIndex - y * morphTargetsTextureSize.x;
		ivec3 morphUV = ivec3( x, y, morphTargetIndex );
		return texelFetch( morphTargetsTexture, morphUV, 0 );
	}
#endif`,Ey=`#ifdef USE_MORPHTARGETS
	transformed *= morphTargetBaseInfluence;
	for ( int i = 0; i < MORPHTARGETS_COUNT; i ++ ) {
		if ( morphTargetInfluences[ i ] != 0.0 ) transformed += getMorph( gl_VertexID, i, 0 ).xyz * morphTargetInfluences[ i ];
	}
#endif`,Ry=`float faceDirection = gl_FrontFacing ? 1.0 : - 1.0;
#ifdef FLAT_SHADED
	vec3 fdx = dFdx( vViewPosition );
	vec3 fdy = dFdy( vViewPosition );
	vec3 normal = normalize( cross( fdx, fdy ) );
#else
	vec3 normal = normalize( vNormal );
	#ifdef DOUBLE_SIDED
		normal *= faceDirection;
	#endif
#endif
#if defined( USE_NORMALMAP_TANGENTSPACE ) || defined( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY )
	#ifdef USE_TANGENT
		mat3 tbn = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn = getTangentFrame( - vViewPosition, normal,
		#if defined( USE_NORMALMAP )
			vNormalMapUv
		#elif defined( USE_CLEARCOAT_NORMALMAP )
			vClearcoatNormalMapUv
		#else
			vUv
		#endif
		);
	#endif
	#ifdef DOUBLE_SIDED
		tbn[0] *= faceDirection;
		tbn[1] *= faceDirection;
	#endif
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	#ifdef USE_TANGENT
		mat3 tbn2 = mat3( normalize( vTangent ), normalize( vBitangent ), normal );
	#else
		mat3 tbn2 = getTangentFrame( - vViewPosition, normal, vClearcoatNormalMapUv );
	#endif
	#ifdef DOUBLE_SIDED
		tbn2[0] *= faceDirection;
		tbn2[1] *= faceDirection;
	#endif
#endif
vec3 nonPerturbedNormal = normal;`,Cy=`#ifdef USE_NORMALMAP_OBJECTSPACE
	normal = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	#ifdef FLIP_SIDED
		normal = - normal;
	#endif
	#ifdef DOUBLE_SIDED
		normal = normal * faceDirection;
	#endif
	normal = normalize( normalMatrix * normal );
#elif defined( USE_NORMALMAP_TANGENTSPACE )
	vec3 mapN = texture2D( normalMap, vNormalMapUv ).xyz * 2.0 - 1.0;
	#if defined( USE_PACKED_NORMALMAP )
		mapN = vec3( mapN.xy, sqrt( saturate( 1.0 - dot( mapN.xy, mapN.xy ) ) ) );
	#endif
	mapN.xy *= normalScale;
	normal = normalize( tbn * mapN );
#elif defined( USE_BUMPMAP )
	normal = perturbNormalArb( - vViewPosition, normal, dHdxy_fwd(), faceDirection );
#endif`,Py=`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,Iy=`#ifndef FLAT_SHADED
	varying vec3 vNormal;
	#ifdef USE_TANGENT
		varying vec3 vTangent;
		varying vec3 vBitangent;
	#endif
#endif`,Ly=`#ifndef FLAT_SHADED
	vNormal = normalize( transformedNormal );
	#ifdef USE_TANGENT
		vTangent = normalize( transformedTangent );
		vBitangent = normalize( cross( vNormal, vTangent ) * tangent.w );
		#ifdef FLIP_SIDED
			vBitangent = - vBitangent;
		#endif
	#endif
#endif`,Dy=`#ifdef USE_NORMALMAP
	uniform sampler2D normalMap;
	uniform vec2 normalScale;
#endif
#ifdef USE_NORMALMAP_OBJECTSPACE
	uniform mat3 normalMatrix;
#endif
#if ! defined ( USE_TANGENT ) && ( defined ( USE_NORMALMAP_TANGENTSPACE ) || defined ( USE_CLEARCOAT_NORMALMAP ) || defined( USE_ANISOTROPY ) )
	mat3 getTangentFrame( vec3 eye_pos, vec3 surf_norm, vec2 uv ) {
		vec3 q0 = dFdx( eye_pos.xyz );
		vec3 q1 = dFdy( eye_pos.xyz );
		vec2 st0 = dFdx( uv.st );
		vec2 st1 = dFdy( uv.st );
		vec3 N = surf_norm;
		vec3 q1perp = cross( q1, N );
		vec3 q0perp = cross( N, q0 );
		vec3 T = q1perp * st0.x + q0perp * st1.x;
		vec3 B = q1perp * st0.y + q0perp * st1.y;
		float det = max( dot( T, T ), dot( B, B ) );
		float scale = ( det == 0.0 ) ? 0.0 : inversesqrt( det );
		return mat3( T * scale, B * scale, N );
	}
#endif`,Ny=`#ifdef USE_CLEARCOAT
	vec3 clearcoatNormal = nonPerturbedNormal;
#endif`,Oy=`#ifdef USE_CLEARCOAT_NORMALMAP
	vec3 clearcoatMapN = texture2D( clearcoatNormalMap, vClearcoatNormalMapUv ).xyz * 2.0 - 1.0;
	clearcoatMapN.xy *= clearcoatNormalScale;
	clearcoatNormal = normalize( tbn2 * clearcoatMapN );
#endif`,Uy=`#ifdef USE_CLEARCOATMAP
	uniform sampler2D clearcoatMap;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform sampler2D clearcoatNormalMap;
	uniform vec2 clearcoatNormalScale;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform sampler2D clearcoatRoughnessMap;
#endif`,Fy=`#ifdef USE_IRIDESCENCEMAP
	uniform sampler2D iridescenceMap;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform sampler2D iridescenceThicknessMap;
#endif`,ky=`#ifdef OPAQUE
diffuseColor.a = 1.0;
#endif
#ifdef USE_TRANSMISSION
diffuseColor.a *= material.transmissionAlpha;
#endif
gl_FragColor = vec4( outgoingLight, diffuseColor.a );`,By=`vec3 packNormalToRGB( const in vec3 normal ) {
	return normalize( normal ) * 0.5 + 0.5;
}
vec3 unpackRGBToNormal( const in vec3 rgb ) {
	return 2.0 * rgb.xyz - 1.0;
}
const float PackUpscale = 256. / 255.;const float UnpackDownscale = 255. / 256.;const float ShiftRight8 = 1. / 256.;
const float Inv255 = 1. / 255.;
const vec4 PackFactors = vec4( 1.0, 256.0, 256.0 * 256.0, 256.0 * 256.0 * 256.0 );
const vec2 UnpackFactors2 = vec2( UnpackDownscale, 1.0 / PackFactors.g );
const vec3 UnpackFactors3 = vec3( UnpackDownscale / PackFactors.rg, 1.0 / PackFactors.b );
const vec4 UnpackFactors4 = vec4( UnpackDownscale / PackFactors.rgb, 1.0 / PackFactors.a );
vec4 packDepthToRGBA( const in float v ) {
	if( v <= 0.0 )
		return vec4( 0., 0., 0., 0. );
	if( v >= 1.0 )
		return vec4( 1., 1., 1., 1. );
	float vuf;
	float af = modf( v * PackFactors.a, vuf );
	float bf = modf( vuf * ShiftRight8, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec4( vuf * Inv255, gf * PackUpscale, bf * PackUpscale, af );
}
vec3 packDepthToRGB( const in float v ) {
	if( v <= 0.0 )
		return vec3( 0., 0., 0. );
	if( v >= 1.0 )
		return vec3( 1., 1., 1. );
	float vuf;
	float bf = modf( v * PackFactors.b, vuf );
	float gf = modf( vuf * ShiftRight8, vuf );
	return vec3( vuf * Inv255, gf * PackUpscale, bf );
}
vec2 packDepthToRG( const in float v ) {
	if( v <= 0.0 )
		return vec2( 0., 0. );
	if( v >= 1.0 )
		return vec2( 1., 1. );
	float vuf;
	float gf = modf( v * 256., vuf );
	return vec2( vuf * Inv255, gf );
}
float unpackRGBAToDepth( const in vec4 v ) {
	return dot( v, UnpackFactors4 );
}
float unpackRGBToDepth( const in vec3 v ) {
	return dot( v, UnpackFactors3 );
}
float unpackRGToDepth( const in vec2 v ) {
	return v.r * UnpackFactors2.r + v.g * UnpackFactors2.g;
}
vec4 pack2HalfToRGBA( const in vec2 v ) {
	vec4 r = vec4( v.x, fract( v.x * 255.0 ), v.y, fract( v.y * 255.0 ) );
	return vec4( r.x - r.y / 255.0, r.y, r.z - r.w / 255.0, r.w );
}
vec2 unpackRGBATo2Half( const in vec4 v ) {
	return vec2( v.x + ( v.y / 255.0 ), v.z + ( v.w / 255.0 ) );
}
float viewZToOrthographicDepth( const in float viewZ, const in float near, const in float far ) {
	return ( viewZ + near ) / ( near - far );
}
float orthographicDepthToViewZ( const in float depth, const in float near, const in float far ) {
	#ifdef USE_REVERSED_DEPTH_BUFFER
	
		return depth * ( far - near ) - far;
	#else
		return depth * ( near - far ) - near;
	#endif
}
float viewZToPerspectiveDepth( const in float viewZ, const in float near, const in float far ) {
	return ( ( near + viewZ ) * far ) / ( ( far - near ) * viewZ );
}
float perspectiveDepthToViewZ( const in float depth, const in float near, const in float far ) {
	
	#ifdef USE_REVERSED_DEPTH_BUFFER
		return ( near * far ) / ( ( near - far ) * depth - near );
	#else
		return ( near * far ) / ( ( far - near ) * depth - far );
	#endif
}`,zy=`#ifdef PREMULTIPLIED_ALPHA
	gl_FragColor.rgb *= gl_FragColor.a;
#endif`,Hy=`vec4 mvPosition = vec4( transformed, 1.0 );
#ifdef USE_BATCHING
	mvPosition = batchingMatrix * mvPosition;
#endif
#ifdef USE_INSTANCING
	mvPosition = instanceMatrix * mvPosition;
#endif
mvPosition = modelViewMatrix * mvPosition;
gl_Position = projectionMatrix * mvPosition;`,Gy=`#ifdef DITHERING
	gl_FragColor.rgb = dithering( gl_FragColor.rgb );
#endif`,Vy=`#ifdef DITHERING
	vec3 dithering( vec3 color ) {
		float grid_position = rand( gl_FragCoord.xy );
		vec3 dither_shift_RGB = vec3( 0.25 / 255.0, -0.25 / 255.0, 0.25 / 255.0 );
		dither_shift_RGB = mix( 2.0 * dither_shift_RGB, -2.0 * dither_shift_RGB, grid_position );
		return color + dither_shift_RGB;
	}
#endif`,Wy=`float roughnessFactor = roughness;
#ifdef USE_ROUGHNESSMAP
	vec4 texelRoughness = texture2D( roughnessMap, vRoughnessMapUv );
	roughnessFactor *= texelRoughness.g;
#endif`,Xy=`#ifdef USE_ROUGHNESSMAP
	uniform sampler2D roughnessMap;
#endif`,qy=`#if NUM_SPOT_LIGHT_COORDS > 0
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#if NUM_SPOT_LIGHT_MAPS > 0
	uniform sampler2D spotLightMap[ NUM_SPOT_LIGHT_MAPS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_SUN_LIGHT_SHADOWS > 0
		#define SUN_LIGHT_CASCADES 2
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform sampler2DShadow sunShadowMap[ NUM_SUN_LIGHT_SHADOWS ];
		#else
			uniform sampler2D sunShadowMap[ NUM_SUN_LIGHT_SHADOWS ];
		#endif
		uniform mat4 sunShadowMatrix[ NUM_SUN_LIGHT_SHADOWS * SUN_LIGHT_CASCADES ];
		uniform vec4 sunShadowCascade[ NUM_SUN_LIGHT_SHADOWS * SUN_LIGHT_CASCADES ];
		varying vec4 vSunShadowWorldPosition;
		varying vec3 vSunShadowWorldNormal;
		struct SunLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SunLightShadow sunLightShadows[ NUM_SUN_LIGHT_SHADOWS ];
	#endif
	#if NUM_DIR_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform sampler2DShadow directionalShadowMap[ NUM_DIR_LIGHT_SHADOWS ];
		#else
			uniform sampler2D directionalShadowMap[ NUM_DIR_LIGHT_SHADOWS ];
		#endif
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform sampler2DShadow spotShadowMap[ NUM_SPOT_LIGHT_SHADOWS ];
		#else
			uniform sampler2D spotShadowMap[ NUM_SPOT_LIGHT_SHADOWS ];
		#endif
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		#if defined( SHADOWMAP_TYPE_PCF )
			uniform samplerCubeShadow pointShadowMap[ NUM_POINT_LIGHT_SHADOWS ];
		#elif defined( SHADOWMAP_TYPE_BASIC )
			uniform samplerCube pointShadowMap[ NUM_POINT_LIGHT_SHADOWS ];
		#endif
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
	#if defined( SHADOWMAP_TYPE_PCF )
		float interleavedGradientNoise( vec2 position ) {
			return fract( 52.9829189 * fract( dot( position, vec2( 0.06711056, 0.00583715 ) ) ) );
		}
		vec2 vogelDiskSample( int sampleIndex, int samplesCount, float phi ) {
			const float goldenAngle = 2.399963229728653;
			float r = sqrt( ( float( sampleIndex ) + 0.5 ) / float( samplesCount ) );
			float theta = float( sampleIndex ) * goldenAngle + phi;
			return vec2( cos( theta ), sin( theta ) ) * r;
		}
	#endif
	#if defined( SHADOWMAP_TYPE_PCF )
		float getShadow( sampler2DShadow shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				shadowCoord.z -= shadowBias;
			#else
				shadowCoord.z += shadowBias;
			#endif
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				vec2 texelSize = vec2( 1.0 ) / shadowMapSize;
				vec2 radius = shadowRadius * texelSize;
				float phi = interleavedGradientNoise( gl_FragCoord.xy ) * PI2;
				shadow = (
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 0, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 1, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 2, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 3, 5, phi ) * radius, shadowCoord.z ) ) +
					texture( shadowMap, vec3( shadowCoord.xy + vogelDiskSample( 4, 5, phi ) * radius, shadowCoord.z ) )
				) * 0.2;
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#elif defined( SHADOWMAP_TYPE_VSM )
		float getShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				shadowCoord.z -= shadowBias;
			#else
				shadowCoord.z += shadowBias;
			#endif
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				vec2 distribution = texture2D( shadowMap, shadowCoord.xy ).rg;
				float mean = distribution.x;
				float variance = distribution.y * distribution.y;
				#ifdef USE_REVERSED_DEPTH_BUFFER
					float hard_shadow = step( mean, shadowCoord.z );
				#else
					float hard_shadow = step( shadowCoord.z, mean );
				#endif
				
				if ( hard_shadow == 1.0 ) {
					shadow = 1.0;
				} else {
					variance = max( variance, 0.0000001 );
					float d = shadowCoord.z - mean;
					float p_max = variance / ( variance + d * d );
					p_max = clamp( ( p_max - 0.3 ) / 0.65, 0.0, 1.0 );
					shadow = max( hard_shadow, p_max );
				}
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#else
		float getShadow( sampler2D shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord ) {
			float shadow = 1.0;
			shadowCoord.xyz /= shadowCoord.w;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				shadowCoord.z -= shadowBias;
			#else
				shadowCoord.z += shadowBias;
			#endif
			bool inFrustum = shadowCoord.x >= 0.0 && shadowCoord.x <= 1.0 && shadowCoord.y >= 0.0 && shadowCoord.y <= 1.0;
			bool frustumTest = inFrustum && shadowCoord.z <= 1.0;
			if ( frustumTest ) {
				float depth = texture2D( shadowMap, shadowCoord.xy ).r;
				#ifdef USE_REVERSED_DEPTH_BUFFER
					shadow = step( depth, shadowCoord.z );
				#else
					shadow = step( shadowCoord.z, depth );
				#endif
			}
			return mix( 1.0, shadow, shadowIntensity );
		}
	#endif
	#if NUM_SUN_LIGHT_SHADOWS > 0
		float getSunShadow(
			#if defined( SHADOWMAP_TYPE_PCF )
				sampler2DShadow shadowMap,
			#else
				sampler2D shadowMap,
			#endif
			SunLightShadow sunLightShadow,
			int shadowIndex
		) {
			vec4 shadowWorldPosition = vec4( vSunShadowWorldPosition.xyz + vSunShadowWorldNormal * sunLightShadow.shadowNormalBias, 1.0 );
			float viewDepth = vSunShadowWorldPosition.w;
			int cascadeOffset = shadowIndex * SUN_LIGHT_CASCADES;
			float shadow = 1.0;
			for ( int i = SUN_LIGHT_CASCADES - 1; i >= 0; i -- ) {
				vec4 cascade = sunShadowCascade[ cascadeOffset + i ];
				if ( viewDepth >= cascade.x && viewDepth < cascade.y ) {
					float cascadeShadow = getShadow(
						shadowMap,
						sunLightShadow.shadowMapSize,
						sunLightShadow.shadowIntensity,
						sunLightShadow.shadowBias,
						sunLightShadow.shadowRadius,
						sunShadowMatrix[ cascadeOffset + i ] * shadowWorldPosition
					);
					shadow = mix( cascadeShadow, shadow, smoothstep( cascade.z, cascade.y, viewDepth ) );
				}
			}
			return shadow;
		}
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
	#if defined( SHADOWMAP_TYPE_PCF )
	float getPointShadow( samplerCubeShadow shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord, float shadowCameraNear, float shadowCameraFar ) {
		float shadow = 1.0;
		vec3 lightToPosition = shadowCoord.xyz;
		vec3 bd3D = normalize( lightToPosition );
		vec3 absVec = abs( lightToPosition );
		float viewSpaceZ = max( max( absVec.x, absVec.y ), absVec.z );
		if ( viewSpaceZ - shadowCameraFar <= 0.0 && viewSpaceZ - shadowCameraNear >= 0.0 ) {
			float lightDistance = length( lightToPosition );
			float depthRange = shadowCameraFar - shadowCameraNear;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				float depthA = - shadowCameraNear / depthRange - shadowBias;
				float depthB = shadowCameraNear * shadowCameraFar / ( depthRange * lightDistance );
			#else
				float depthA = shadowCameraFar / depthRange + shadowBias;
				float depthB = - shadowCameraNear * shadowCameraFar / ( depthRange * lightDistance );
			#endif
			float texelSize = shadowRadius / shadowMapSize.x;
			vec3 absDir = abs( bd3D );
			vec3 tangent = absDir.x > absDir.z ? vec3( 0.0, 1.0, 0.0 ) : vec3( 1.0, 0.0, 0.0 );
			tangent = normalize( cross( bd3D, tangent ) );
			vec3 bitangent = cross( bd3D, tangent );
			float phi = interleavedGradientNoise( gl_FragCoord.xy ) * PI2;
			shadow = 0.0;
			for ( int i = 0; i < 5; i ++ ) {
				vec2 offset = vogelDiskSample( i, 5, phi );
				vec3 direction = bd3D + ( tangent * offset.x + bitangent * offset.y ) * texelSize;
				vec3 absDirection = abs( direction );
				float dp = depthA + depthB / max( max( absDirection.x, absDirection.y ), absDirection.z );
				shadow += texture( shadowMap, vec4( direction, dp ) );
			}
			shadow *= 0.2;
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
	#elif defined( SHADOWMAP_TYPE_BASIC )
	float getPointShadow( samplerCube shadowMap, vec2 shadowMapSize, float shadowIntensity, float shadowBias, float shadowRadius, vec4 shadowCoord, float shadowCameraNear, float shadowCameraFar ) {
		float shadow = 1.0;
		vec3 lightToPosition = shadowCoord.xyz;
		vec3 absVec = abs( lightToPosition );
		float viewSpaceZ = max( max( absVec.x, absVec.y ), absVec.z );
		if ( viewSpaceZ - shadowCameraFar <= 0.0 && viewSpaceZ - shadowCameraNear >= 0.0 ) {
			float dp = ( shadowCameraFar * ( viewSpaceZ - shadowCameraNear ) ) / ( viewSpaceZ * ( shadowCameraFar - shadowCameraNear ) );
			dp += shadowBias;
			vec3 bd3D = normalize( lightToPosition );
			float depth = textureCube( shadowMap, bd3D ).r;
			#ifdef USE_REVERSED_DEPTH_BUFFER
				depth = 1.0 - depth;
			#endif
			shadow = step( dp, depth );
		}
		return mix( 1.0, shadow, shadowIntensity );
	}
	#endif
	#endif
#endif`,$y=`#if NUM_SPOT_LIGHT_COORDS > 0
	uniform mat4 spotLightMatrix[ NUM_SPOT_LIGHT_COORDS ];
	varying vec4 vSpotLightCoord[ NUM_SPOT_LIGHT_COORDS ];
#endif
#ifdef USE_SHADOWMAP
	#if NUM_SUN_LIGHT_SHADOWS > 0
		varying vec4 vSunShadowWorldPosition;
		varying vec3 vSunShadowWorldNormal;
	#endif
	#if NUM_DIR_LIGHT_SHADOWS > 0
		uniform mat4 directionalShadowMatrix[ NUM_DIR_LIGHT_SHADOWS ];
		varying vec4 vDirectionalShadowCoord[ NUM_DIR_LIGHT_SHADOWS ];
		struct DirectionalLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform DirectionalLightShadow directionalLightShadows[ NUM_DIR_LIGHT_SHADOWS ];
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
		struct SpotLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
		};
		uniform SpotLightShadow spotLightShadows[ NUM_SPOT_LIGHT_SHADOWS ];
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		uniform mat4 pointShadowMatrix[ NUM_POINT_LIGHT_SHADOWS ];
		varying vec4 vPointShadowCoord[ NUM_POINT_LIGHT_SHADOWS ];
		struct PointLightShadow {
			float shadowIntensity;
			float shadowBias;
			float shadowNormalBias;
			float shadowRadius;
			vec2 shadowMapSize;
			float shadowCameraNear;
			float shadowCameraFar;
		};
		uniform PointLightShadow pointLightShadows[ NUM_POINT_LIGHT_SHADOWS ];
	#endif
#endif`,Yy=`#if ( defined( USE_SHADOWMAP ) && ( NUM_DIR_LIGHT_SHADOWS > 0 || NUM_SUN_LIGHT_SHADOWS > 0 || NUM_POINT_LIGHT_SHADOWS > 0 ) ) || ( NUM_SPOT_LIGHT_COORDS > 0 )
	#ifdef HAS_NORMAL
		vec3 shadowWorldNormal = transformNormalByInverseViewMatrix( transformedNormal, viewMatrix );
	#else
		vec3 shadowWorldNormal = vec3( 0.0 );
	#endif
	vec4 shadowWorldPosition;
#endif
#if defined( USE_SHADOWMAP )
	#if NUM_SUN_LIGHT_SHADOWS > 0
		vSunShadowWorldPosition = vec4( worldPosition.xyz, - mvPosition.z );
		vSunShadowWorldNormal = shadowWorldNormal;
	#endif
	#if NUM_DIR_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * directionalLightShadows[ i ].shadowNormalBias, 0 );
			vDirectionalShadowCoord[ i ] = directionalShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0
		#pragma unroll_loop_start
		for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
			shadowWorldPosition = worldPosition + vec4( shadowWorldNormal * pointLightShadows[ i ].shadowNormalBias, 0 );
			vPointShadowCoord[ i ] = pointShadowMatrix[ i ] * shadowWorldPosition;
		}
		#pragma unroll_loop_end
	#endif
#endif
#if NUM_SPOT_LIGHT_COORDS > 0
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_COORDS; i ++ ) {
		shadowWorldPosition = worldPosition;
		#if ( defined( USE_SHADOWMAP ) && UNROLLED_LOOP_INDEX < NUM_SPOT_LIGHT_SHADOWS )
			shadowWorldPosition.xyz += shadowWorldNormal * spotLightShadows[ i ].shadowNormalBias;
		#endif
		vSpotLightCoord[ i ] = spotLightMatrix[ i ] * shadowWorldPosition;
	}
	#pragma unroll_loop_end
#endif`,Ky=`float getShadowMask() {
	float shadow = 1.0;
	#ifdef USE_SHADOWMAP
	#if NUM_SUN_LIGHT_SHADOWS > 0
	SunLightShadow sunLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SUN_LIGHT_SHADOWS; i ++ ) {
		sunLight = sunLightShadows[ i ];
		shadow *= receiveShadow ? getSunShadow( sunShadowMap[ i ], sunLight, UNROLLED_LOOP_INDEX ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_DIR_LIGHT_SHADOWS > 0
	DirectionalLightShadow directionalLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_DIR_LIGHT_SHADOWS; i ++ ) {
		directionalLight = directionalLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( directionalShadowMap[ i ], directionalLight.shadowMapSize, directionalLight.shadowIntensity, directionalLight.shadowBias, directionalLight.shadowRadius, vDirectionalShadowCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_SPOT_LIGHT_SHADOWS > 0
	SpotLightShadow spotLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_SPOT_LIGHT_SHADOWS; i ++ ) {
		spotLight = spotLightShadows[ i ];
		shadow *= receiveShadow ? getShadow( spotShadowMap[ i ], spotLight.shadowMapSize, spotLight.shadowIntensity, spotLight.shadowBias, spotLight.shadowRadius, vSpotLightCoord[ i ] ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#if NUM_POINT_LIGHT_SHADOWS > 0 && ( defined( SHADOWMAP_TYPE_PCF ) || defined( SHADOWMAP_TYPE_BASIC ) )
	PointLightShadow pointLight;
	#pragma unroll_loop_start
	for ( int i = 0; i < NUM_POINT_LIGHT_SHADOWS; i ++ ) {
		pointLight = pointLightShadows[ i ];
		shadow *= receiveShadow ? getPointShadow( pointShadowMap[ i ], pointLight.shadowMapSize, pointLight.shadowIntensity, pointLight.shadowBias, pointLight.shadowRadius, vPointShadowCoord[ i ], pointLight.shadowCameraNear, pointLight.shadowCameraFar ) : 1.0;
	}
	#pragma unroll_loop_end
	#endif
	#endif
	return shadow;
}`,jy=`#ifdef USE_SKINNING
	mat4 boneMatX = getBoneMatrix( skinIndex.x );
	mat4 boneMatY = getBoneMatrix( skinIndex.y );
	mat4 boneMatZ = getBoneMatrix( skinIndex.z );
	mat4 boneMatW = getBoneMatrix( skinIndex.w );
#endif`,Zy=`#ifdef USE_SKINNING
	uniform mat4 bindMatrix;
	uniform mat4 bindMatrixInverse;
	uniform highp sampler2D boneTexture;
	mat4 getBoneMatrix( const in float i ) {
		int size = textureSize( boneTexture, 0 ).x;
		int j = int( i ) * 4;
		int x = j % size;
		int y = j / size;
		vec4 v1 = texelFetch( boneTexture, ivec2( x, y ), 0 );
		vec4 v2 = texelFetch( boneTexture, ivec2( x + 1, y ), 0 );
		vec4 v3 = texelFetch( boneTexture, ivec2( x + 2, y ), 0 );
		vec4 v4 = texelFetch( boneTexture, ivec2( x + 3, y ), 0 );
		return mat4( v1, v2, v3, v4 );
	}
#endif`,Jy=`#ifdef USE_SKINNING
	vec4 skinVertex = bindMatrix * vec4( transformed, 1.0 );
	vec4 skinned = vec4( 0.0 );
	skinned += boneMatX * skinVertex * skinWeight.x;
	skinned += boneMatY * skinVertex * skinWeight.y;
	skinned += boneMatZ * skinVertex * skinWeight.z;
	skinned += boneMatW * skinVertex * skinWeight.w;
	transformed = ( bindMatrixInverse * skinned ).xyz;
#endif`,Qy=`#ifdef USE_SKINNING
	mat4 skinMatrix = mat4( 0.0 );
	skinMatrix += skinWeight.x * boneMatX;
	skinMatrix += skinWeight.y * boneMatY;
	skinMatrix += skinWeight.z * boneMatZ;
	skinMatrix += skinWeight.w * boneMatW;
	skinMatrix = bindMatrixInverse * skinMatrix * bindMatrix;
	objectNormal = vec4( skinMatrix * vec4( objectNormal, 0.0 ) ).xyz;
	#ifdef USE_TANGENT
		objectTangent = vec4( skinMatrix * vec4( objectTangent, 0.0 ) ).xyz;
	#endif
#endif`,ev=`float specularStrength;
#ifdef USE_SPECULARMAP
	vec4 texelSpecular = texture2D( specularMap, vSpecularMapUv );
	specularStrength = texelSpecular.r;
#else
	specularStrength = 1.0;
#endif`,tv=`#ifdef USE_SPECULARMAP
	uniform sampler2D specularMap;
#endif`,nv=`#if defined( TONE_MAPPING )
	gl_FragColor.rgb = toneMapping( gl_FragColor.rgb );
#endif`,iv=`#ifndef saturate
#define saturate( a ) clamp( a, 0.0, 1.0 )
#endif
uniform float toneMappingExposure;
vec3 LinearToneMapping( vec3 color ) {
	return saturate( toneMappingExposure * color );
}
vec3 ReinhardToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	return saturate( color / ( vec3( 1.0 ) + color ) );
}
vec3 CineonToneMapping( vec3 color ) {
	color *= toneMappingExposure;
	color = max( vec3( 0.0 ), color - 0.004 );
	return pow( ( color * ( 6.2 * color + 0.5 ) ) / ( color * ( 6.2 * color + 1.7 ) + 0.06 ), vec3( 2.2 ) );
}
vec3 RRTAndODTFit( vec3 v ) {
	vec3 a = v * ( v + 0.0245786 ) - 0.000090537;
	vec3 b = v * ( 0.983729 * v + 0.4329510 ) + 0.238081;
	return a / b;
}
vec3 ACESFilmicToneMapping( vec3 color ) {
	const mat3 ACESInputMat = mat3(
		vec3( 0.59719, 0.07600, 0.02840 ),		vec3( 0.35458, 0.90834, 0.13383 ),
		vec3( 0.04823, 0.01566, 0.83777 )
	);
	const mat3 ACESOutputMat = mat3(
		vec3(  1.60475, -0.10208, -0.00327 ),		vec3( -0.53108,  1.10813, -0.07276 ),
		vec3( -0.07367, -0.00605,  1.07602 )
	);
	color *= toneMappingExposure / 0.6;
	color = ACESInputMat * color;
	color = RRTAndODTFit( color );
	color = ACESOutputMat * color;
	return saturate( color );
}
const mat3 LINEAR_REC2020_TO_LINEAR_SRGB = mat3(
	vec3( 1.6605, - 0.1246, - 0.0182 ),
	vec3( - 0.5876, 1.1329, - 0.1006 ),
	vec3( - 0.0728, - 0.0083, 1.1187 )
);
const mat3 LINEAR_SRGB_TO_LINEAR_REC2020 = mat3(
	vec3( 0.6274, 0.0691, 0.0164 ),
	vec3( 0.3293, 0.9195, 0.0880 ),
	vec3( 0.0433, 0.0113, 0.8956 )
);
vec3 agxDefaultContrastApprox( vec3 x ) {
	vec3 x2 = x * x;
	vec3 x4 = x2 * x2;
	return + 15.5 * x4 * x2
		- 40.14 * x4 * x
		+ 31.96 * x4
		- 6.868 * x2 * x
		+ 0.4298 * x2
		+ 0.1191 * x
		- 0.00232;
}
vec3 AgXToneMapping( vec3 color ) {
	const mat3 AgXInsetMatrix = mat3(
		vec3( 0.856627153315983, 0.137318972929847, 0.11189821299995 ),
		vec3( 0.0951212405381588, 0.761241990602591, 0.0767994186031903 ),
		vec3( 0.0482516061458583, 0.101439036467562, 0.811302368396859 )
	);
	const mat3 AgXOutsetMatrix = mat3(
		vec3( 1.1271005818144368, - 0.1413297634984383, - 0.14132976349843826 ),
		vec3( - 0.11060664309660323, 1.157823702216272, - 0.11060664309660294 ),
		vec3( - 0.016493938717834573, - 0.016493938717834257, 1.2519364065950405 )
	);
	const float AgxMinEv = - 12.47393;	const float AgxMaxEv = 4.026069;
	color *= toneMappingExposure;
	color = LINEAR_SRGB_TO_LINEAR_REC2020 * color;
	color = AgXInsetMatrix * color;
	color = max( color, 1e-10 );	color = log2( color );
	color = ( color - AgxMinEv ) / ( AgxMaxEv - AgxMinEv );
	color = clamp( color, 0.0, 1.0 );
	color = agxDefaultContrastApprox( color );
	color = AgXOutsetMatrix * color;
	color = pow( max( vec3( 0.0 ), color ), vec3( 2.2 ) );
	color = LINEAR_REC2020_TO_LINEAR_SRGB * color;
	color = clamp( color, 0.0, 1.0 );
	return color;
}
vec3 NeutralToneMapping( vec3 color ) {
	const float StartCompression = 0.8 - 0.04;
	const float Desaturation = 0.15;
	color *= toneMappingExposure;
	float x = min( color.r, min( color.g, color.b ) );
	float offset = x < 0.08 ? x - 6.25 * x * x : 0.04;
	color -= offset;
	float peak = max( color.r, max( color.g, color.b ) );
	if ( peak < StartCompression ) return color;
	float d = 1. - StartCompression;
	float newPeak = 1. - d * d / ( peak + d - StartCompression );
	color *= newPeak / peak;
	float g = 1. - 1. / ( Desaturation * ( peak - newPeak ) + 1. );
	return mix( color, vec3( newPeak ), g );
}
vec3 CustomToneMapping( vec3 color ) { return color; }`,sv=`#ifdef USE_TRANSMISSION
	material.transmission = transmission;
	material.transmissionAlpha = 1.0;
	material.thickness = thickness;
	material.attenuationDistance = attenuationDistance;
	material.attenuationColor = attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		material.transmission *= texture2D( transmissionMap, vTransmissionMapUv ).r;
	#endif
	#ifdef USE_THICKNESSMAP
		material.thickness *= texture2D( thicknessMap, vThicknessMapUv ).g;
	#endif
	vec3 pos = vWorldPosition;
	vec3 v = normalize( cameraPosition - pos );
	vec3 n = transformNormalByInverseViewMatrix( normal, viewMatrix );
	vec4 transmitted = getIBLVolumeRefraction(
		n, v, material.roughness, material.diffuseContribution, material.specularColorBlended, material.specularF90,
		pos, modelMatrix, viewMatrix, projectionMatrix, material.dispersion, material.ior, material.thickness,
		material.attenuationColor, material.attenuationDistance );
	material.transmissionAlpha = mix( material.transmissionAlpha, transmitted.a, material.transmission );
	totalDiffuse = mix( totalDiffuse, transmitted.rgb, material.transmission );
#endif`,rv=`#ifdef USE_TRANSMISSION
	uniform float transmission;
	uniform float thickness;
	uniform float attenuationDistance;
	uniform vec3 attenuationColor;
	#ifdef USE_TRANSMISSIONMAP
		uniform sampler2D transmissionMap;
	#endif
	#ifdef USE_THICKNESSMAP
		uniform sampler2D thicknessMap;
	#endif
	uniform vec2 transmissionSamplerSize;
	uniform sampler2D transmissionSamplerMap;
	uniform mat4 modelMatrix;
	uniform mat4 projectionMatrix;
	varying vec3 vWorldPosition;
	float w0( float a ) {
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - a + 3.0 ) - 3.0 ) + 1.0 );
	}
	float w1( float a ) {
		return ( 1.0 / 6.0 ) * ( a *  a * ( 3.0 * a - 6.0 ) + 4.0 );
	}
	float w2( float a ){
		return ( 1.0 / 6.0 ) * ( a * ( a * ( - 3.0 * a + 3.0 ) + 3.0 ) + 1.0 );
	}
	float w3( float a ) {
		return ( 1.0 / 6.0 ) * ( a * a * a );
	}
	float g0( float a ) {
		return w0( a ) + w1( a );
	}
	float g1( float a ) {
		return w2( a ) + w3( a );
	}
	float h0( float a ) {
		return - 1.0 + w1( a ) / ( w0( a ) + w1( a ) );
	}
	float h1( float a ) {
		return 1.0 + w3( a ) / ( w2( a ) + w3( a ) );
	}
	vec4 bicubic( sampler2D tex, vec2 uv, vec4 texelSize, float lod ) {
		uv = uv * texelSize.zw + 0.5;
		vec2 iuv = floor( uv );
		vec2 fuv = fract( uv );
		float g0x = g0( fuv.x );
		float g1x = g1( fuv.x );
		float h0x = h0( fuv.x );
		float h1x = h1( fuv.x );
		float h0y = h0( fuv.y );
		float h1y = h1( fuv.y );
		vec2 p0 = ( vec2( iuv.x + h0x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p1 = ( vec2( iuv.x + h1x, iuv.y + h0y ) - 0.5 ) * texelSize.xy;
		vec2 p2 = ( vec2( iuv.x + h0x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		vec2 p3 = ( vec2( iuv.x + h1x, iuv.y + h1y ) - 0.5 ) * texelSize.xy;
		return g0( fuv.y ) * ( g0x * textureLod( tex, p0, lod ) + g1x * textureLod( tex, p1, lod ) ) +
			g1( fuv.y ) * ( g0x * textureLod( tex, p2, lod ) + g1x * textureLod( tex, p3, lod ) );
	}
	vec4 textureBicubic( sampler2D sampler, vec2 uv, float lod ) {
		vec2 fLodSize = vec2( textureSize( sampler, int( lod ) ) );
		vec2 cLodSize = vec2( textureSize( sampler, int( lod + 1.0 ) ) );
		vec2 fLodSizeInv = 1.0 / fLodSize;
		vec2 cLodSizeInv = 1.0 / cLodSize;
		vec4 fSample = bicubic( sampler, uv, vec4( fLodSizeInv, fLodSize ), floor( lod ) );
		vec4 cSample = bicubic( sampler, uv, vec4( cLodSizeInv, cLodSize ), ceil( lod ) );
		return mix( fSample, cSample, fract( lod ) );
	}
	vec3 getVolumeTransmissionRay( const in vec3 n, const in vec3 v, const in float thickness, const in float ior, const in mat4 modelMatrix ) {
		vec3 refractionVector = refract( - v, normalize( n ), 1.0 / ior );
		vec3 modelScale;
		modelScale.x = length( vec3( modelMatrix[ 0 ].xyz ) );
		modelScale.y = length( vec3( modelMatrix[ 1 ].xyz ) );
		modelScale.z = length( vec3( modelMatrix[ 2 ].xyz ) );
		return normalize( refractionVector ) * thickness * modelScale;
	}
	float applyIorToRoughness( const in float roughness, const in float ior ) {
		return roughness * clamp( ior * 2.0 - 2.0, 0.0, 1.0 );
	}
	vec4 getTransmissionSample( const in vec2 fragCoord, const in float roughness, const in float ior ) {
		float lod = log2( transmissionSamplerSize.x ) * applyIorToRoughness( roughness, ior );
		return textureBicubic( transmissionSamplerMap, fragCoord.xy, lod );
	}
	vec3 volumeAttenuation( const in float transmissionDistance, const in vec3 attenuationColor, const in float attenuationDistance ) {
		if ( isinf( attenuationDistance ) ) {
			return vec3( 1.0 );
		} else {
			vec3 attenuationCoefficient = -log( attenuationColor ) / attenuationDistance;
			vec3 transmittance = exp( - attenuationCoefficient * transmissionDistance );			return transmittance;
		}
	}
	vec4 getIBLVolumeRefraction( const in vec3 n, const in vec3 v, const in float roughness, const in vec3 diffuseColor,
		const in vec3 specularColor, const in float specularF90, const in vec3 position, const in mat4 modelMatrix,
		const in mat4 viewMatrix, const in mat4 projMatrix, const in float dispersion, const in float ior, const in float thickness,
		const in vec3 attenuationColor, const in float attenuationDistance ) {
		vec4 transmittedLight;
		vec3 transmittance;
		#ifdef USE_DISPERSION
			float halfSpread = ( ior - 1.0 ) * 0.025 * dispersion;
			vec3 iors = vec3( ior - halfSpread, ior, ior + halfSpread );
			for ( int i = 0; i < 3; i ++ ) {
				vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, iors[ i ], modelMatrix );
				vec3 refractedRayExit = position + transmissionRay;
				vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
				vec2 refractionCoords = ndcPos.xy / ndcPos.w;
				refractionCoords += 1.0;
				refractionCoords /= 2.0;
				vec4 transmissionSample = getTransmissionSample( refractionCoords, roughness, iors[ i ] );
				transmittedLight[ i ] = transmissionSample[ i ];
				transmittedLight.a += transmissionSample.a;
				transmittance[ i ] = diffuseColor[ i ] * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance )[ i ];
			}
			transmittedLight.a /= 3.0;
		#else
			vec3 transmissionRay = getVolumeTransmissionRay( n, v, thickness, ior, modelMatrix );
			vec3 refractedRayExit = position + transmissionRay;
			vec4 ndcPos = projMatrix * viewMatrix * vec4( refractedRayExit, 1.0 );
			vec2 refractionCoords = ndcPos.xy / ndcPos.w;
			refractionCoords += 1.0;
			refractionCoords /= 2.0;
			transmittedLight = getTransmissionSample( refractionCoords, roughness, ior );
			transmittance = diffuseColor * volumeAttenuation( length( transmissionRay ), attenuationColor, attenuationDistance );
		#endif
		vec3 attenuatedColor = transmittance * transmittedLight.rgb;
		vec3 F = EnvironmentBRDF( n, v, specularColor, specularF90, roughness );
		float transmittanceFactor = ( transmittance.r + transmittance.g + transmittance.b ) / 3.0;
		return vec4( ( 1.0 - F ) * attenuatedColor, 1.0 - ( 1.0 - transmittedLight.a ) * transmittanceFactor );
	}
#endif`,ov=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_DIFFUSE_ROUGHNESSMAP
	varying vec2 vDiffuseRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_SPECULARMAP
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,av=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	varying vec2 vUv;
#endif
#ifdef USE_MAP
	uniform mat3 mapTransform;
	varying vec2 vMapUv;
#endif
#ifdef USE_ALPHAMAP
	uniform mat3 alphaMapTransform;
	varying vec2 vAlphaMapUv;
#endif
#ifdef USE_LIGHTMAP
	uniform mat3 lightMapTransform;
	varying vec2 vLightMapUv;
#endif
#ifdef USE_AOMAP
	uniform mat3 aoMapTransform;
	varying vec2 vAoMapUv;
#endif
#ifdef USE_BUMPMAP
	uniform mat3 bumpMapTransform;
	varying vec2 vBumpMapUv;
#endif
#ifdef USE_NORMALMAP
	uniform mat3 normalMapTransform;
	varying vec2 vNormalMapUv;
#endif
#ifdef USE_DISPLACEMENTMAP
	uniform mat3 displacementMapTransform;
	varying vec2 vDisplacementMapUv;
#endif
#ifdef USE_EMISSIVEMAP
	uniform mat3 emissiveMapTransform;
	varying vec2 vEmissiveMapUv;
#endif
#ifdef USE_METALNESSMAP
	uniform mat3 metalnessMapTransform;
	varying vec2 vMetalnessMapUv;
#endif
#ifdef USE_ROUGHNESSMAP
	uniform mat3 roughnessMapTransform;
	varying vec2 vRoughnessMapUv;
#endif
#ifdef USE_DIFFUSE_ROUGHNESSMAP
	uniform mat3 diffuseRoughnessMapTransform;
	varying vec2 vDiffuseRoughnessMapUv;
#endif
#ifdef USE_ANISOTROPYMAP
	uniform mat3 anisotropyMapTransform;
	varying vec2 vAnisotropyMapUv;
#endif
#ifdef USE_CLEARCOATMAP
	uniform mat3 clearcoatMapTransform;
	varying vec2 vClearcoatMapUv;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	uniform mat3 clearcoatNormalMapTransform;
	varying vec2 vClearcoatNormalMapUv;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	uniform mat3 clearcoatRoughnessMapTransform;
	varying vec2 vClearcoatRoughnessMapUv;
#endif
#ifdef USE_SHEEN_COLORMAP
	uniform mat3 sheenColorMapTransform;
	varying vec2 vSheenColorMapUv;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	uniform mat3 sheenRoughnessMapTransform;
	varying vec2 vSheenRoughnessMapUv;
#endif
#ifdef USE_IRIDESCENCEMAP
	uniform mat3 iridescenceMapTransform;
	varying vec2 vIridescenceMapUv;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	uniform mat3 iridescenceThicknessMapTransform;
	varying vec2 vIridescenceThicknessMapUv;
#endif
#ifdef USE_SPECULARMAP
	uniform mat3 specularMapTransform;
	varying vec2 vSpecularMapUv;
#endif
#ifdef USE_SPECULAR_COLORMAP
	uniform mat3 specularColorMapTransform;
	varying vec2 vSpecularColorMapUv;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	uniform mat3 specularIntensityMapTransform;
	varying vec2 vSpecularIntensityMapUv;
#endif
#ifdef USE_TRANSMISSIONMAP
	uniform mat3 transmissionMapTransform;
	varying vec2 vTransmissionMapUv;
#endif
#ifdef USE_THICKNESSMAP
	uniform mat3 thicknessMapTransform;
	varying vec2 vThicknessMapUv;
#endif`,lv=`#if defined( USE_UV ) || defined( USE_ANISOTROPY )
	vUv = vec3( uv, 1 ).xy;
#endif
#ifdef USE_MAP
	vMapUv = ( mapTransform * vec3( MAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ALPHAMAP
	vAlphaMapUv = ( alphaMapTransform * vec3( ALPHAMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_LIGHTMAP
	vLightMapUv = ( lightMapTransform * vec3( LIGHTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_AOMAP
	vAoMapUv = ( aoMapTransform * vec3( AOMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_BUMPMAP
	vBumpMapUv = ( bumpMapTransform * vec3( BUMPMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_NORMALMAP
	vNormalMapUv = ( normalMapTransform * vec3( NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_DISPLACEMENTMAP
	vDisplacementMapUv = ( displacementMapTransform * vec3( DISPLACEMENTMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_EMISSIVEMAP
	vEmissiveMapUv = ( emissiveMapTransform * vec3( EMISSIVEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_METALNESSMAP
	vMetalnessMapUv = ( metalnessMapTransform * vec3( METALNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ROUGHNESSMAP
	vRoughnessMapUv = ( roughnessMapTransform * vec3( ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_DIFFUSE_ROUGHNESSMAP
	vDiffuseRoughnessMapUv = ( diffuseRoughnessMapTransform * vec3( DIFFUSE_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_ANISOTROPYMAP
	vAnisotropyMapUv = ( anisotropyMapTransform * vec3( ANISOTROPYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOATMAP
	vClearcoatMapUv = ( clearcoatMapTransform * vec3( CLEARCOATMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_NORMALMAP
	vClearcoatNormalMapUv = ( clearcoatNormalMapTransform * vec3( CLEARCOAT_NORMALMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESSMAP
	vClearcoatRoughnessMapUv = ( clearcoatRoughnessMapTransform * vec3( CLEARCOAT_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCEMAP
	vIridescenceMapUv = ( iridescenceMapTransform * vec3( IRIDESCENCEMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_IRIDESCENCE_THICKNESSMAP
	vIridescenceThicknessMapUv = ( iridescenceThicknessMapTransform * vec3( IRIDESCENCE_THICKNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_COLORMAP
	vSheenColorMapUv = ( sheenColorMapTransform * vec3( SHEEN_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SHEEN_ROUGHNESSMAP
	vSheenRoughnessMapUv = ( sheenRoughnessMapTransform * vec3( SHEEN_ROUGHNESSMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULARMAP
	vSpecularMapUv = ( specularMapTransform * vec3( SPECULARMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_COLORMAP
	vSpecularColorMapUv = ( specularColorMapTransform * vec3( SPECULAR_COLORMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_SPECULAR_INTENSITYMAP
	vSpecularIntensityMapUv = ( specularIntensityMapTransform * vec3( SPECULAR_INTENSITYMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_TRANSMISSIONMAP
	vTransmissionMapUv = ( transmissionMapTransform * vec3( TRANSMISSIONMAP_UV, 1 ) ).xy;
#endif
#ifdef USE_THICKNESSMAP
	vThicknessMapUv = ( thicknessMapTransform * vec3( THICKNESSMAP_UV, 1 ) ).xy;
#endif`,cv=`#if defined( USE_ENVMAP ) || defined( DISTANCE ) || defined ( USE_SHADOWMAP ) || defined ( USE_TRANSMISSION ) || NUM_SPOT_LIGHT_COORDS > 0
	vec4 worldPosition = vec4( transformed, 1.0 );
	#ifdef USE_BATCHING
		worldPosition = batchingMatrix * worldPosition;
	#endif
	#ifdef USE_INSTANCING
		worldPosition = instanceMatrix * worldPosition;
	#endif
	worldPosition = modelMatrix * worldPosition;
#endif`,hv=`varying vec2 vUv;
uniform mat3 uvTransform;
void main() {
	vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	gl_Position = vec4( position.xy, 1.0, 1.0 );
}`,uv=`uniform sampler2D t2D;
uniform float backgroundIntensity;
varying vec2 vUv;
void main() {
	vec4 texColor = texture2D( t2D, vUv );
	#ifdef DECODE_VIDEO_TEXTURE
		texColor = vec4( mix( pow( texColor.rgb * 0.9478672986 + vec3( 0.0521327014 ), vec3( 2.4 ) ), texColor.rgb * 0.0773993808, vec3( lessThanEqual( texColor.rgb, vec3( 0.04045 ) ) ) ), texColor.w );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,dv=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,fv=`uniform float backgroundBlurriness;
uniform float backgroundIntensity;
uniform mat3 backgroundRotation;
varying vec3 vWorldDirection;
#include <envmap_common_pars_fragment>
void main() {
	#ifdef ENVMAP_TYPE_PMREM
		vec4 texColor = textureLod( envMap, backgroundRotation * vWorldDirection, roughnessToMip( backgroundBlurriness ) );
	#else
		vec4 texColor = textureCube( envMap, backgroundRotation * vWorldDirection );
	#endif
	texColor.rgb *= backgroundIntensity;
	gl_FragColor = texColor;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,pv=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
	gl_Position.z = gl_Position.w;
}`,mv=`uniform samplerCube tCube;
uniform float tFlip;
uniform float opacity;
varying vec3 vWorldDirection;
void main() {
	vec4 texColor = textureCube( tCube, vec3( tFlip * vWorldDirection.x, vWorldDirection.yz ) );
	gl_FragColor = texColor;
	gl_FragColor.a *= opacity;
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,gv=`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
varying vec2 vHighPrecisionZW;
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vHighPrecisionZW = gl_Position.zw;
}`,xv=`#if DEPTH_PACKING == 3200
	uniform float opacity;
#endif
#include <common>
#include <packing>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
varying vec2 vHighPrecisionZW;
void main() {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#if DEPTH_PACKING == 3200
		diffuseColor.a = opacity;
	#endif
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <logdepthbuf_fragment>
	#ifdef USE_REVERSED_DEPTH_BUFFER
		float fragCoordZ = vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ];
	#else
		float fragCoordZ = 0.5 * vHighPrecisionZW[ 0 ] / vHighPrecisionZW[ 1 ] + 0.5;
	#endif
	#if DEPTH_PACKING == 3200
		gl_FragColor = vec4( vec3( 1.0 - fragCoordZ ), opacity );
	#elif DEPTH_PACKING == 3201
		gl_FragColor = packDepthToRGBA( fragCoordZ );
	#elif DEPTH_PACKING == 3202
		gl_FragColor = vec4( packDepthToRGB( fragCoordZ ), 1.0 );
	#elif DEPTH_PACKING == 3203
		gl_FragColor = vec4( packDepthToRG( fragCoordZ ), 0.0, 1.0 );
	#endif
}`,yv=`#define DISTANCE
varying vec3 vWorldPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <skinbase_vertex>
	#include <morphinstance_vertex>
	#ifdef USE_DISPLACEMENTMAP
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <worldpos_vertex>
	#include <clipping_planes_vertex>
	vWorldPosition = worldPosition.xyz;
}`,vv=`#define DISTANCE
uniform vec3 referencePosition;
uniform float nearDistance;
uniform float farDistance;
varying vec3 vWorldPosition;
#include <common>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( 1.0 );
	#include <clipping_planes_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	float dist = length( vWorldPosition - referencePosition );
	dist = ( dist - nearDistance ) / ( farDistance - nearDistance );
	dist = saturate( dist );
	gl_FragColor = vec4( dist, 0.0, 0.0, 1.0 );
}`,_v=`varying vec3 vWorldDirection;
#include <common>
void main() {
	vWorldDirection = transformDirection( position, modelMatrix );
	#include <begin_vertex>
	#include <project_vertex>
}`,bv=`uniform sampler2D tEquirect;
varying vec3 vWorldDirection;
#include <common>
void main() {
	vec3 direction = normalize( vWorldDirection );
	vec2 sampleUV = equirectUv( direction );
	gl_FragColor = texture2D( tEquirect, sampleUV );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
}`,Mv=`uniform float scale;
attribute float lineDistance;
varying float vLineDistance;
#include <common>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	vLineDistance = scale * lineDistance;
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,wv=`uniform vec3 diffuse;
uniform float opacity;
uniform float dashSize;
uniform float totalSize;
varying float vLineDistance;
#include <common>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	if ( mod( vLineDistance, totalSize ) > dashSize ) {
		discard;
	}
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,Sv=`#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#if defined ( USE_ENVMAP ) || defined ( USE_SKINNING )
		#include <beginnormal_vertex>
		#include <morphnormal_vertex>
		#include <skinbase_vertex>
		#include <skinnormal_vertex>
		#include <defaultnormal_vertex>
	#endif
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <fog_vertex>
}`,Tv=`uniform vec3 diffuse;
uniform float opacity;
#ifndef FLAT_SHADED
	varying vec3 vNormal;
#endif
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <fog_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	#ifdef USE_LIGHTMAP
		vec4 lightMapTexel = texture2D( lightMap, vLightMapUv );
		reflectedLight.indirectDiffuse += lightMapTexel.rgb * lightMapIntensity * RECIPROCAL_PI;
	#else
		reflectedLight.indirectDiffuse += vec3( 1.0 );
	#endif
	#include <aomap_fragment>
	reflectedLight.indirectDiffuse *= diffuseColor.rgb;
	vec3 outgoingLight = reflectedLight.indirectDiffuse;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,Av=`#define LAMBERT
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,Ev=`#define LAMBERT
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_lambert_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_lambert_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,Rv=`#define MATCAP
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <color_pars_vertex>
#include <displacementmap_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
	vViewPosition = - mvPosition.xyz;
}`,Cv=`#define MATCAP
uniform vec3 diffuse;
uniform float opacity;
uniform sampler2D matcap;
varying vec3 vViewPosition;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	vec3 viewDir = normalize( vViewPosition );
	vec3 x = normalize( vec3( viewDir.z, 0.0, - viewDir.x ) );
	vec3 y = cross( viewDir, x );
	vec2 uv = vec2( dot( x, normal ), dot( y, normal ) ) * 0.495 + 0.5;
	#ifdef USE_MATCAP
		vec4 matcapColor = texture2D( matcap, uv );
	#else
		vec4 matcapColor = vec4( vec3( mix( 0.2, 0.8, uv.y ) ), 1.0 );
	#endif
	vec3 outgoingLight = diffuseColor.rgb * matcapColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,Pv=`#define NORMAL
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	vViewPosition = - mvPosition.xyz;
#endif
}`,Iv=`#define NORMAL
uniform float opacity;
#if defined( FLAT_SHADED ) || defined( USE_BUMPMAP ) || defined( USE_NORMALMAP_TANGENTSPACE )
	varying vec3 vViewPosition;
#endif
#include <uv_pars_fragment>
#include <normal_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( 0.0, 0.0, 0.0, opacity );
	#include <clipping_planes_fragment>
	#include <logdepthbuf_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	gl_FragColor = vec4( normalize( normal ) * 0.5 + 0.5, diffuseColor.a );
	#ifdef OPAQUE
		gl_FragColor.a = 1.0;
	#endif
}`,Lv=`#define PHONG
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <envmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <envmap_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,Dv=`#define PHONG
uniform vec3 diffuse;
uniform vec3 emissive;
uniform vec3 specular;
uniform float shininess;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_phong_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <specularmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <specularmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_phong_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + reflectedLight.directSpecular + reflectedLight.indirectSpecular + totalEmissiveRadiance;
	#include <envmap_fragment>
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,Nv=`#define STANDARD
varying vec3 vViewPosition;
#ifdef USE_TRANSMISSION
	varying vec3 vWorldPosition;
#endif
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
#ifdef USE_TRANSMISSION
	vWorldPosition = worldPosition.xyz;
#endif
}`,Ov=`#define STANDARD
#ifdef PHYSICAL
	#define IOR
	#define USE_SPECULAR
#endif
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float roughness;
uniform float metalness;
uniform float opacity;
#ifdef IOR
	uniform float ior;
#endif
#ifdef USE_SPECULAR
	uniform float specularIntensity;
	uniform vec3 specularColor;
	#ifdef USE_SPECULAR_COLORMAP
		uniform sampler2D specularColorMap;
	#endif
	#ifdef USE_SPECULAR_INTENSITYMAP
		uniform sampler2D specularIntensityMap;
	#endif
#endif
#ifdef USE_CLEARCOAT
	uniform float clearcoat;
	uniform float clearcoatRoughness;
#endif
#ifdef USE_DIFFUSE_ROUGHNESS
	uniform float diffuseRoughness;
	#ifdef USE_DIFFUSE_ROUGHNESSMAP
		uniform sampler2D diffuseRoughnessMap;
	#endif
#endif
#ifdef USE_DISPERSION
	uniform float dispersion;
#endif
#ifdef USE_RETROREFLECTION
	uniform float retroreflectivity;
#endif
#ifdef USE_IRIDESCENCE
	uniform float iridescence;
	uniform float iridescenceIOR;
	uniform float iridescenceThicknessMinimum;
	uniform float iridescenceThicknessMaximum;
#endif
#ifdef USE_SHEEN
	uniform vec3 sheenColor;
	uniform float sheenRoughness;
	#ifdef USE_SHEEN_COLORMAP
		uniform sampler2D sheenColorMap;
	#endif
	#ifdef USE_SHEEN_ROUGHNESSMAP
		uniform sampler2D sheenRoughnessMap;
	#endif
#endif
#ifdef USE_ANISOTROPY
	uniform vec2 anisotropyVector;
	#ifdef USE_ANISOTROPYMAP
		uniform sampler2D anisotropyMap;
	#endif
#endif
varying vec3 vViewPosition;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <iridescence_fragment>
#include <envmap_common_pars_fragment>
#include <envmap_physical_pars_fragment>
#include <fog_pars_fragment>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_physical_pars_fragment>
#include <transmission_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <clearcoat_pars_fragment>
#include <iridescence_pars_fragment>
#include <roughnessmap_pars_fragment>
#include <metalnessmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <roughnessmap_fragment>
	#include <metalnessmap_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <clearcoat_normal_fragment_begin>
	#include <clearcoat_normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_physical_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 totalDiffuse = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse;
	vec3 totalSpecular = reflectedLight.directSpecular + reflectedLight.indirectSpecular;
	#include <transmission_fragment>
	vec3 outgoingLight = totalDiffuse + totalSpecular + totalEmissiveRadiance;
	#ifdef USE_SHEEN
 
		outgoingLight = outgoingLight + sheenSpecularDirect + sheenSpecularIndirect;
 
 	#endif
	#ifdef USE_CLEARCOAT
		float dotNVcc = saturate( dot( geometryClearcoatNormal, geometryViewDir ) );
		vec3 Fcc = F_Schlick( material.clearcoatF0, material.clearcoatF90, dotNVcc );
		outgoingLight = outgoingLight * ( 1.0 - material.clearcoat * Fcc ) + ( clearcoatSpecularDirect + clearcoatSpecularIndirect ) * material.clearcoat;
	#endif
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,Uv=`#define TOON
varying vec3 vViewPosition;
#include <common>
#include <batching_pars_vertex>
#include <uv_pars_vertex>
#include <displacementmap_pars_vertex>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <normal_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <shadowmap_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <normal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <displacementmap_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	vViewPosition = - mvPosition.xyz;
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,Fv=`#define TOON
uniform vec3 diffuse;
uniform vec3 emissive;
uniform float opacity;
#include <common>
#include <dithering_pars_fragment>
#include <color_pars_fragment>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <aomap_pars_fragment>
#include <lightmap_pars_fragment>
#include <emissivemap_pars_fragment>
#include <gradientmap_pars_fragment>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <normal_pars_fragment>
#include <lights_toon_pars_fragment>
#include <shadowmap_pars_fragment>
#include <bumpmap_pars_fragment>
#include <normalmap_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	ReflectedLight reflectedLight = ReflectedLight( vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ), vec3( 0.0 ) );
	vec3 totalEmissiveRadiance = emissive;
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <color_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	#include <normal_fragment_begin>
	#include <normal_fragment_maps>
	#include <emissivemap_fragment>
	#include <lights_toon_fragment>
	#include <lights_fragment_begin>
	#include <lights_fragment_maps>
	#include <lights_fragment_end>
	#include <aomap_fragment>
	vec3 outgoingLight = reflectedLight.directDiffuse + reflectedLight.indirectDiffuse + totalEmissiveRadiance;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
	#include <dithering_fragment>
}`,kv=`uniform float size;
uniform float scale;
#include <common>
#include <color_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
#ifdef USE_POINTS_UV
	varying vec2 vUv;
	uniform mat3 uvTransform;
#endif
void main() {
	#ifdef USE_POINTS_UV
		vUv = ( uvTransform * vec3( uv, 1 ) ).xy;
	#endif
	#include <color_vertex>
	#include <morphinstance_vertex>
	#include <morphcolor_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <project_vertex>
	gl_PointSize = size;
	#ifdef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) gl_PointSize *= ( scale / - mvPosition.z );
	#endif
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <worldpos_vertex>
	#include <fog_vertex>
}`,Bv=`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <color_pars_fragment>
#include <map_particle_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_particle_fragment>
	#include <color_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,zv=`#include <common>
#include <batching_pars_vertex>
#include <fog_pars_vertex>
#include <morphtarget_pars_vertex>
#include <skinning_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <shadowmap_pars_vertex>
void main() {
	#include <batching_vertex>
	#include <beginnormal_vertex>
	#include <morphinstance_vertex>
	#include <morphnormal_vertex>
	#include <skinbase_vertex>
	#include <skinnormal_vertex>
	#include <defaultnormal_vertex>
	#include <begin_vertex>
	#include <morphtarget_vertex>
	#include <skinning_vertex>
	#include <project_vertex>
	#include <logdepthbuf_vertex>
	#include <worldpos_vertex>
	#include <shadowmap_vertex>
	#include <fog_vertex>
}`,Hv=`uniform vec3 color;
uniform float opacity;
#include <common>
#include <fog_pars_fragment>
#include <bsdfs>
#include <lights_pars_begin>
#include <logdepthbuf_pars_fragment>
#include <shadowmap_pars_fragment>
#include <shadowmask_pars_fragment>
void main() {
	#include <logdepthbuf_fragment>
	gl_FragColor = vec4( color, opacity * ( 1.0 - getShadowMask() ) );
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
	#include <premultiplied_alpha_fragment>
}`,Gv=`uniform float rotation;
uniform vec2 center;
#include <common>
#include <uv_pars_vertex>
#include <fog_pars_vertex>
#include <logdepthbuf_pars_vertex>
#include <clipping_planes_pars_vertex>
void main() {
	#include <uv_vertex>
	vec4 mvPosition = modelViewMatrix[ 3 ];
	vec2 scale = vec2( length( modelMatrix[ 0 ].xyz ), length( modelMatrix[ 1 ].xyz ) );
	#ifndef USE_SIZEATTENUATION
		bool isPerspective = isPerspectiveMatrix( projectionMatrix );
		if ( isPerspective ) scale *= - mvPosition.z;
	#endif
	vec2 alignedPosition = ( position.xy - ( center - vec2( 0.5 ) ) ) * scale;
	vec2 rotatedPosition;
	rotatedPosition.x = cos( rotation ) * alignedPosition.x - sin( rotation ) * alignedPosition.y;
	rotatedPosition.y = sin( rotation ) * alignedPosition.x + cos( rotation ) * alignedPosition.y;
	mvPosition.xy += rotatedPosition;
	gl_Position = projectionMatrix * mvPosition;
	#include <logdepthbuf_vertex>
	#include <clipping_planes_vertex>
	#include <fog_vertex>
}`,Vv=`uniform vec3 diffuse;
uniform float opacity;
#include <common>
#include <uv_pars_fragment>
#include <map_pars_fragment>
#include <alphamap_pars_fragment>
#include <alphatest_pars_fragment>
#include <alphahash_pars_fragment>
#include <fog_pars_fragment>
#include <logdepthbuf_pars_fragment>
#include <clipping_planes_pars_fragment>
void main() {
	vec4 diffuseColor = vec4( diffuse, opacity );
	#include <clipping_planes_fragment>
	vec3 outgoingLight = vec3( 0.0 );
	#include <logdepthbuf_fragment>
	#include <map_fragment>
	#include <alphamap_fragment>
	#include <alphatest_fragment>
	#include <alphahash_fragment>
	outgoingLight = diffuseColor.rgb;
	#include <opaque_fragment>
	#include <tonemapping_fragment>
	#include <colorspace_fragment>
	#include <fog_fragment>
}`,We={alphahash_fragment:ux,alphahash_pars_fragment:dx,alphamap_fragment:fx,alphamap_pars_fragment:px,alphatest_fragment:mx,alphatest_pars_fragment:gx,aomap_fragment:xx,aomap_pars_fragment:yx,batching_pars_vertex:vx,batching_vertex:_x,begin_vertex:bx,beginnormal_vertex:Mx,bsdfs:wx,iridescence_fragment:Sx,bumpmap_pars_fragment:Tx,clipping_planes_fragment:Ax,clipping_planes_pars_fragment:Ex,clipping_planes_pars_vertex:Rx,clipping_planes_vertex:Cx,color_fragment:Px,color_pars_fragment:Ix,color_pars_vertex:Lx,color_vertex:Dx,common:Nx,defaultnormal_vertex:Ox,displacementmap_pars_vertex:Ux,displacementmap_vertex:Fx,emissivemap_fragment:kx,emissivemap_pars_fragment:Bx,colorspace_fragment:zx,colorspace_pars_fragment:Hx,envmap_fragment:Gx,envmap_common_pars_fragment:Vx,envmap_pars_fragment:Wx,envmap_pars_vertex:Xx,envmap_physical_pars_fragment:ny,envmap_vertex:qx,fog_vertex:$x,fog_pars_vertex:Yx,fog_fragment:Kx,fog_pars_fragment:jx,gradientmap_pars_fragment:Zx,lightmap_pars_fragment:Jx,lights_lambert_fragment:Qx,lights_lambert_pars_fragment:ey,lights_pars_begin:ty,lights_toon_fragment:iy,lights_toon_pars_fragment:sy,lights_phong_fragment:ry,lights_phong_pars_fragment:oy,lights_physical_fragment:ay,lights_physical_pars_fragment:ly,lights_fragment_begin:cy,lights_fragment_maps:hy,lights_fragment_end:uy,lightprobes_pars_fragment:dy,logdepthbuf_fragment:fy,logdepthbuf_pars_fragment:py,logdepthbuf_pars_vertex:my,logdepthbuf_vertex:gy,map_fragment:xy,map_pars_fragment:yy,map_particle_fragment:vy,map_particle_pars_fragment:_y,metalnessmap_fragment:by,metalnessmap_pars_fragment:My,morphinstance_vertex:wy,morphcolor_vertex:Sy,morphnormal_vertex:Ty,morphtarget_pars_vertex:Ay,morphtarget_vertex:Ey,normal_fragment_begin:Ry,normal_fragment_maps:Cy,normal_pars_fragment:Py,normal_pars_vertex:Iy,normal_vertex:Ly,normalmap_pars_fragment:Dy,clearcoat_normal_fragment_begin:Ny,clearcoat_normal_fragment_maps:Oy,clearcoat_pars_fragment:Uy,iridescence_pars_fragment:Fy,opaque_fragment:ky,packing:By,premultiplied_alpha_fragment:zy,project_vertex:Hy,dithering_fragment:Gy,dithering_pars_fragment:Vy,roughnessmap_fragment:Wy,roughnessmap_pars_fragment:Xy,shadowmap_pars_fragment:qy,shadowmap_pars_vertex:$y,shadowmap_vertex:Yy,shadowmask_pars_fragment:Ky,skinbase_vertex:jy,skinning_pars_vertex:Zy,skinning_vertex:Jy,skinnormal_vertex:Qy,specularmap_fragment:ev,specularmap_pars_fragment:tv,tonemapping_fragment:nv,tonemapping_pars_fragment:iv,transmission_fragment:sv,transmission_pars_fragment:rv,uv_pars_fragment:ov,uv_pars_vertex:av,uv_vertex:lv,worldpos_vertex:cv,background_vert:hv,background_frag:uv,backgroundCube_vert:dv,backgroundCube_frag:fv,cube_vert:pv,cube_frag:mv,depth_vert:gv,depth_frag:xv,distance_vert:yv,distance_frag:vv,equirect_vert:_v,equirect_frag:bv,linedashed_vert:Mv,linedashed_frag:wv,meshbasic_vert:Sv,meshbasic_frag:Tv,meshlambert_vert:Av,meshlambert_frag:Ev,meshmatcap_vert:Rv,meshmatcap_frag:Cv,meshnormal_vert:Pv,meshnormal_frag:Iv,meshphong_vert:Lv,meshphong_frag:Dv,meshphysical_vert:Nv,meshphysical_frag:Ov,meshtoon_vert:Uv,meshtoon_frag:Fv,points_vert:kv,points_frag:Bv,shadow_vert:zv,shadow_frag:Hv,sprite_vert:Gv,sprite_frag:Vv},pe={common:{diffuse:{value:new ve(16777215)},opacity:{value:1},map:{value:null},mapTransform:{value:new Fe},alphaMap:{value:null},alphaMapTransform:{value:new Fe},alphaTest:{value:0}},specularmap:{specularMap:{value:null},specularMapTransform:{value:new Fe}},envmap:{envMap:{value:null},envMapRotation:{value:new Fe},reflectivity:{value:1},ior:{value:1.5},refractionRatio:{value:.98},dfgLUT:{value:null}},aomap:{aoMap:{value:null},aoMapIntensity:{value:1},aoMapTransform:{value:new Fe}},lightmap:{lightMap:{value:null},lightMapIntensity:{value:1},lightMapTransform:{value:new Fe}},bumpmap:{bumpMap:{value:null},bumpMapTransform:{value:new Fe},bumpScale:{value:1}},normalmap:{normalMap:{value:null},normalMapTransform:{value:new Fe},normalScale:{value:new ye(1,1)}},displacementmap:{displacementMap:{value:null},displacementMapTransform:{value:new Fe},displacementScale:{value:1},displacementBias:{value:0}},emissivemap:{emissiveMap:{value:null},emissiveMapTransform:{value:new Fe}},metalnessmap:{metalnessMap:{value:null},metalnessMapTransform:{value:new Fe}},roughnessmap:{roughnessMap:{value:null},roughnessMapTransform:{value:new Fe}},gradientmap:{gradientMap:{value:null}},fog:{fogDensity:{value:25e-5},fogNear:{value:1},fogFar:{value:2e3},fogColor:{value:new ve(16777215)}},lights:{ambientLightColor:{value:[]},lightProbe:{value:[]},sunLights:{value:[],properties:{direction:{},color:{}}},sunLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},sunShadowMatrix:{value:[]},sunShadowCascade:{value:[]},directionalLights:{value:[],properties:{direction:{},color:{}}},directionalLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},directionalShadowMatrix:{value:[]},spotLights:{value:[],properties:{color:{},position:{},direction:{},distance:{},coneCos:{},penumbraCos:{},decay:{}}},spotLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{}}},spotLightMap:{value:[]},spotLightMatrix:{value:[]},pointLights:{value:[],properties:{color:{},position:{},decay:{},distance:{}}},pointLightShadows:{value:[],properties:{shadowIntensity:1,shadowBias:{},shadowNormalBias:{},shadowRadius:{},shadowMapSize:{},shadowCameraNear:{},shadowCameraFar:{}}},pointShadowMatrix:{value:[]},hemisphereLights:{value:[],properties:{direction:{},skyColor:{},groundColor:{}}},rectAreaLights:{value:[],properties:{color:{},position:{},width:{},height:{}}},ltc_1:{value:null},ltc_2:{value:null},probesSH:{value:[]},probesMin:{value:[]},probesMax:{value:[]},probesResolution:{value:[]}},points:{diffuse:{value:new ve(16777215)},opacity:{value:1},size:{value:1},scale:{value:1},map:{value:null},alphaMap:{value:null},alphaMapTransform:{value:new Fe},alphaTest:{value:0},uvTransform:{value:new Fe}},sprite:{diffuse:{value:new ve(16777215)},opacity:{value:1},center:{value:new ye(.5,.5)},rotation:{value:0},map:{value:null},mapTransform:{value:new Fe},alphaMap:{value:null},alphaMapTransform:{value:new Fe},alphaTest:{value:0}}},si={basic:{uniforms:nn([pe.common,pe.specularmap,pe.envmap,pe.aomap,pe.lightmap,pe.fog]),vertexShader:We.meshbasic_vert,fragmentShader:We.meshbasic_frag},lambert:{uniforms:nn([pe.common,pe.specularmap,pe.envmap,pe.aomap,pe.lightmap,pe.emissivemap,pe.bumpmap,pe.normalmap,pe.displacementmap,pe.fog,pe.lights,{emissive:{value:new ve(0)},envMapIntensity:{value:1}}]),vertexShader:We.meshlambert_vert,fragmentShader:We.meshlambert_frag},phong:{uniforms:nn([pe.common,pe.specularmap,pe.envmap,pe.aomap,pe.lightmap,pe.emissivemap,pe.bumpmap,pe.normalmap,pe.displacementmap,pe.fog,pe.lights,{emissive:{value:new ve(0)},specular:{value:new ve(1118481)},shininess:{value:30},envMapIntensity:{value:1}}]),vertexShader:We.meshphong_vert,fragmentShader:We.meshphong_frag},standard:{uniforms:nn([pe.common,pe.envmap,pe.aomap,pe.lightmap,pe.emissivemap,pe.bumpmap,pe.normalmap,pe.displacementmap,pe.roughnessmap,pe.metalnessmap,pe.fog,pe.lights,{emissive:{value:new ve(0)},roughness:{value:1},metalness:{value:0},envMapIntensity:{value:1}}]),vertexShader:We.meshphysical_vert,fragmentShader:We.meshphysical_frag},toon:{uniforms:nn([pe.common,pe.aomap,pe.lightmap,pe.emissivemap,pe.bumpmap,pe.normalmap,pe.displacementmap,pe.gradientmap,pe.fog,pe.lights,{emissive:{value:new ve(0)}}]),vertexShader:We.meshtoon_vert,fragmentShader:We.meshtoon_frag},matcap:{uniforms:nn([pe.common,pe.bumpmap,pe.normalmap,pe.displacementmap,pe.fog,{matcap:{value:null}}]),vertexShader:We.meshmatcap_vert,fragmentShader:We.meshmatcap_frag},points:{uniforms:nn([pe.points,pe.fog]),vertexShader:We.points_vert,fragmentShader:We.points_frag},dashed:{uniforms:nn([pe.common,pe.fog,{scale:{value:1},dashSize:{value:1},totalSize:{value:2}}]),vertexShader:We.linedashed_vert,fragmentShader:We.linedashed_frag},depth:{uniforms:nn([pe.common,pe.displacementmap]),vertexShader:We.depth_vert,fragmentShader:We.depth_frag},normal:{uniforms:nn([pe.common,pe.bumpmap,pe.normalmap,pe.displacementmap,{opacity:{value:1}}]),vertexShader:We.meshnormal_vert,fragmentShader:We.meshnormal_frag},sprite:{uniforms:nn([pe.sprite,pe.fog]),vertexShader:We.sprite_vert,fragmentShader:We.sprite_frag},background:{uniforms:{uvTransform:{value:new Fe},t2D:{value:null},backgroundIntensity:{value:1}},vertexShader:We.background_vert,fragmentShader:We.background_frag},backgroundCube:{uniforms:{envMap:{value:null},backgroundBlurriness:{value:0},backgroundIntensity:{value:1},backgroundRotation:{value:new Fe}},vertexShader:We.backgroundCube_vert,fragmentShader:We.backgroundCube_frag},cube:{uniforms:{tCube:{value:null},tFlip:{value:-1},opacity:{value:1}},vertexShader:We.cube_vert,fragmentShader:We.cube_frag},equirect:{uniforms:{tEquirect:{value:null}},vertexShader:We.equirect_vert,fragmentShader:We.equirect_frag},distance:{uniforms:nn([pe.common,pe.displacementmap,{referencePosition:{value:new S},nearDistance:{value:1},farDistance:{value:1e3}}]),vertexShader:We.distance_vert,fragmentShader:We.distance_frag},shadow:{uniforms:nn([pe.lights,pe.fog,{color:{value:new ve(0)},opacity:{value:1}}]),vertexShader:We.shadow_vert,fragmentShader:We.shadow_frag}};si.physical={uniforms:nn([si.standard.uniforms,{clearcoat:{value:0},clearcoatMap:{value:null},clearcoatMapTransform:{value:new Fe},clearcoatNormalMap:{value:null},clearcoatNormalMapTransform:{value:new Fe},clearcoatNormalScale:{value:new ye(1,1)},clearcoatRoughness:{value:0},clearcoatRoughnessMap:{value:null},clearcoatRoughnessMapTransform:{value:new Fe},diffuseRoughness:{value:0},diffuseRoughnessMap:{value:null},diffuseRoughnessMapTransform:{value:new Fe},dispersion:{value:0},retroreflectivity:{value:0},iridescence:{value:0},iridescenceMap:{value:null},iridescenceMapTransform:{value:new Fe},iridescenceIOR:{value:1.3},iridescenceThicknessMinimum:{value:100},iridescenceThicknessMaximum:{value:400},iridescenceThicknessMap:{value:null},iridescenceThicknessMapTransform:{value:new Fe},sheen:{value:0},sheenColor:{value:new ve(0)},sheenColorMap:{value:null},sheenColorMapTransform:{value:new Fe},sheenRoughness:{value:1},sheenRoughnessMap:{value:null},sheenRoughnessMapTransform:{value:new Fe},transmission:{value:0},transmissionMap:{value:null},transmissionMapTransform:{value:new Fe},transmissionSamplerSize:{value:new ye},transmissionSamplerMap:{value:null},thickness:{value:0},thicknessMap:{value:null},thicknessMapTransform:{value:new Fe},attenuationDistance:{value:0},attenuationColor:{value:new ve(0)},specularColor:{value:new ve(1,1,1)},specularColorMap:{value:null},specularColorMapTransform:{value:new Fe},specularIntensity:{value:1},specularIntensityMap:{value:null},specularIntensityMapTransform:{value:new Fe},anisotropyVector:{value:new ye},anisotropyMap:{value:null},anisotropyMapTransform:{value:new Fe}}]),vertexShader:We.meshphysical_vert,fragmentShader:We.meshphysical_frag};var zl={r:0,b:0,g:0},Wv=new _e,Kp=new Fe;Kp.set(-1,0,0,0,1,0,0,0,1);function Xv(s,e,t,n,i,r){let o=new ve(0),a=i===!0?0:1,l,c,h=null,u=0,d=null;function f(b){let E=b.isScene===!0?b.background:null;if(E&&E.isTexture){let M=b.backgroundBlurriness>0;E=e.get(E,M)}return E}function g(b){let E=!1,M=f(b);M===null?p(o,a):M&&M.isColor&&(p(M,1),E=!0);let R=s.xr.getEnvironmentBlendMode();R==="additive"?t.buffers.color.setClear(0,0,0,1,r):R==="alpha-blend"&&t.buffers.color.setClear(0,0,0,0,r),(s.autoClear||E)&&(t.buffers.depth.setTest(!0),t.buffers.depth.setMask(!0),t.buffers.color.setMask(!0),s.clear(s.autoClearColor,s.autoClearDepth,s.autoClearStencil))}function y(b,E){let M=f(E);M&&M.isCubeTexture?(c===void 0&&(c=new ue(new ln(1,1,1),new dn({name:"BackgroundCubeMaterial",uniforms:Es(si.backgroundCube.uniforms),vertexShader:si.backgroundCube.vertexShader,fragmentShader:si.backgroundCube.fragmentShader,side:Kt,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),c.geometry.deleteAttribute("normal"),c.geometry.deleteAttribute("uv"),c.onBeforeRender=function(R,T,x){this.matrixWorld.copyPosition(x.matrixWorld)},Object.defineProperty(c.material,"envMap",{get:function(){return this.uniforms.envMap.value}}),n.update(c)),c.material.uniforms.envMap.value=M,c.material.uniforms.backgroundBlurriness.value=E.backgroundBlurriness,c.material.uniforms.backgroundIntensity.value=E.backgroundIntensity,c.material.uniforms.backgroundRotation.value.setFromMatrix4(Wv.makeRotationFromEuler(E.backgroundRotation)).transpose(),M.isRenderTargetTexture===!1&&c.material.uniforms.backgroundRotation.value.premultiply(Kp),c.material.toneMapped=Xe.getTransfer(M.colorSpace)!==nt,(h!==M||u!==M.version||d!==s.toneMapping)&&(c.material.needsUpdate=!0,h=M,u=M.version,d=s.toneMapping),c.layers.enableAll(),b.unshift(c,c.geometry,c.material,0,0,null)):M&&M.isTexture&&(l===void 0&&(l=new ue(new Vt(2,2),new dn({name:"BackgroundMaterial",uniforms:Es(si.background.uniforms),vertexShader:si.background.vertexShader,fragmentShader:si.background.fragmentShader,side:ei,depthTest:!1,depthWrite:!1,fog:!1,allowOverride:!1})),l.geometry.deleteAttribute("normal"),Object.defineProperty(l.material,"map",{get:function(){return this.uniforms.t2D.value}}),n.update(l)),l.material.uniforms.t2D.value=M,l.material.uniforms.backgroundIntensity.value=E.backgroundIntensity,l.material.toneMapped=Xe.getTransfer(M.colorSpace)!==nt,M.matrixAutoUpdate===!0&&M.updateMatrix(),l.material.uniforms.uvTransform.value.copy(M.matrix),(h!==M||u!==M.version||d!==s.toneMapping)&&(l.material.needsUpdate=!0,h=M,u=M.version,d=s.toneMapping),l.layers.enableAll(),b.unshift(l,l.geometry,l.material,0,0,null))}function p(b,E){b.getRGB(zl,wu(s)),t.buffers.color.setClear(zl.r,zl.g,zl.b,E,r)}function m(){c!==void 0&&(c.geometry.dispose(),c.material.dispose(),c=void 0),l!==void 0&&(l.geometry.dispose(),l.material.dispose(),l=void 0)}return{getClearColor:function(){return o},setClearColor:function(b,E=1){o.set(b),a=E,p(o,a)},getClearAlpha:function(){return a},setClearAlpha:function(b){a=b,p(o,a)},render:g,addToRenderList:y,dispose:m}}function qv(s,e){let t=s.getParameter(s.MAX_VERTEX_ATTRIBS),n={},i=d(null),r=i,o=!1;function a(N,k,V,P,G){let q=!1,H=u(N,P,V,k);r!==H&&(r=H,c(r.object)),q=f(N,P,V,G),q&&g(N,P,V,G),G!==null&&e.update(G,s.ELEMENT_ARRAY_BUFFER),(q||o)&&(o=!1,M(N,k,V,P),G!==null&&s.bindBuffer(s.ELEMENT_ARRAY_BUFFER,e.get(G).buffer))}function l(){return s.createVertexArray()}function c(N){return s.bindVertexArray(N)}function h(N){return s.deleteVertexArray(N)}function u(N,k,V,P){let G=P.wireframe===!0,q=n[k.id];q===void 0&&(q={},n[k.id]=q);let H=N.isInstancedMesh===!0?N.id:0,te=q[H];te===void 0&&(te={},q[H]=te);let X=te[V.id];X===void 0&&(X={},te[V.id]=X);let J=X[G];return J===void 0&&(J=d(l()),X[G]=J),J}function d(N){let k=[],V=[],P=[];for(let G=0;G<t;G++)k[G]=0,V[G]=0,P[G]=0;return{geometry:null,program:null,wireframe:!1,newAttributes:k,enabledAttributes:V,attributeDivisors:P,object:N,attributes:{},index:null}}function f(N,k,V,P){let G=r.attributes,q=k.attributes,H=0,te=V.getAttributes();for(let X in te)if(te[X].location>=0){let Q=G[X],Te=q[X];if(Te===void 0&&(X==="instanceMatrix"&&N.instanceMatrix&&(Te=N.instanceMatrix),X==="instanceColor"&&N.instanceColor&&(Te=N.instanceColor)),Q===void 0||Q.attribute!==Te||Te&&Q.data!==Te.data)return!0;H++}return r.attributesNum!==H||r.index!==P}function g(N,k,V,P){let G={},q=k.attributes,H=0,te=V.getAttributes();for(let X in te)if(te[X].location>=0){let Q=q[X];Q===void 0&&(X==="instanceMatrix"&&N.instanceMatrix&&(Q=N.instanceMatrix),X==="instanceColor"&&N.instanceColor&&(Q=N.instanceColor));let Te={};Te.attribute=Q,Q&&Q.data&&(Te.data=Q.data),G[X]=Te,H++}r.attributes=G,r.attributesNum=H,r.index=P}function y(){let N=r.newAttributes;for(let k=0,V=N.length;k<V;k++)N[k]=0}function p(N){m(N,0)}function m(N,k){let V=r.newAttributes,P=r.enabledAttributes,G=r.attributeDivisors;V[N]=1,P[N]===0&&(s.enableVertexAttribArray(N),P[N]=1),G[N]!==k&&(s.vertexAttribDivisor(N,k),G[N]=k)}function b(){let N=r.newAttributes,k=r.enabledAttributes;for(let V=0,P=k.length;V<P;V++)k[V]!==N[V]&&(s.disableVertexAttribArray(V),k[V]=0)}function E(N,k,V,P,G,q,H){H===!0?s.vertexAttribIPointer(N,k,V,G,q):s.vertexAttribPointer(N,k,V,P,G,q)}function M(N,k,V,P){y();let G=P.attributes,q=V.getAttributes(),H=k.defaultAttributeValues;for(let te in q){let X=q[te];if(X.location>=0){let J=G[te];if(J===void 0&&(te==="instanceMatrix"&&N.instanceMatrix&&(J=N.instanceMatrix),te==="instanceColor"&&N.instanceColor&&(J=N.instanceColor)),J!==void 0){let Q=J.normalized,Te=J.itemSize,Be=e.get(J);if(Be===void 0)continue;let K=Be.buffer,me=Be.type,Me=Be.bytesPerElement,Ie=me===s.INT||me===s.UNSIGNED_INT||J.gpuType===nl;if(J.isInterleavedBufferAttribute){let ge=J.data,He=ge.isInterleavedBuffer===!0?ge.stride:ge.itemSize,Rt=J.offset;if(ge.isInstancedInterleavedBuffer||ge.isInstancedBufferAttribute){for(let Ne=0;Ne<X.locationSize;Ne++)m(X.location+Ne,ge.meshPerAttribute);N.isInstancedMesh!==!0&&P._maxInstanceCount===void 0&&(P._maxInstanceCount=ge.meshPerAttribute*ge.count)}else for(let Ne=0;Ne<X.locationSize;Ne++)p(X.location+Ne);s.bindBuffer(s.ARRAY_BUFFER,K);for(let Ne=0;Ne<X.locationSize;Ne++)E(X.location+Ne,Te/X.locationSize,me,Q,He*Me,(Rt+Te/X.locationSize*Ne)*Me,Ie)}else{if(J.isInstancedBufferAttribute){for(let ge=0;ge<X.locationSize;ge++)m(X.location+ge,J.meshPerAttribute);N.isInstancedMesh!==!0&&P._maxInstanceCount===void 0&&(P._maxInstanceCount=J.meshPerAttribute*J.count)}else for(let ge=0;ge<X.locationSize;ge++)p(X.location+ge);s.bindBuffer(s.ARRAY_BUFFER,K);for(let ge=0;ge<X.locationSize;ge++)E(X.location+ge,Te/X.locationSize,me,Q,Te*Me,Te/X.locationSize*ge*Me,Ie)}}else if(H!==void 0){let Q=H[te];if(Q!==void 0)switch(Q.length){case 2:s.vertexAttrib2fv(X.location,Q);break;case 3:s.vertexAttrib3fv(X.location,Q);break;case 4:s.vertexAttrib4fv(X.location,Q);break;default:s.vertexAttrib1fv(X.location,Q)}}}}b()}function R(){O();for(let N in n){let k=n[N];for(let V in k){let P=k[V];for(let G in P){let q=P[G];for(let H in q)h(q[H].object),delete q[H];delete P[G]}}delete n[N]}}function T(N){if(n[N.id]===void 0)return;let k=n[N.id];for(let V in k){let P=k[V];for(let G in P){let q=P[G];for(let H in q)h(q[H].object),delete q[H];delete P[G]}}delete n[N.id]}function x(N){for(let k in n){let V=n[k];for(let P in V){let G=V[P];if(G[N.id]===void 0)continue;let q=G[N.id];for(let H in q)h(q[H].object),delete q[H];delete G[N.id]}}}function w(N){for(let k in n){let V=n[k],P=N.isInstancedMesh===!0?N.id:0,G=V[P];if(G!==void 0){for(let q in G){let H=G[q];for(let te in H)h(H[te].object),delete H[te];delete G[q]}delete V[P],Object.keys(V).length===0&&delete n[k]}}}function O(){I(),o=!0,r!==i&&(r=i,c(r.object))}function I(){i.geometry=null,i.program=null,i.wireframe=!1}return{setup:a,reset:O,resetDefaultState:I,dispose:R,releaseStatesOfGeometry:T,releaseStatesOfObject:w,releaseStatesOfProgram:x,initAttributes:y,enableAttribute:p,disableUnusedAttributes:b}}function $v(s,e,t){let n;function i(l){n=l}function r(l,c){s.drawArrays(n,l,c),t.update(c,n,1)}function o(l,c,h){h!==0&&(s.drawArraysInstanced(n,l,c,h),t.update(c,n,h))}function a(l,c,h){if(h===0)return;e.get("WEBGL_multi_draw").multiDrawArraysWEBGL(n,l,0,c,0,h);let d=0;for(let f=0;f<h;f++)d+=c[f];t.update(d,n,1)}this.setMode=i,this.render=r,this.renderInstances=o,this.renderMultiDraw=a}function Yv(s,e,t,n){let i;function r(){if(i!==void 0)return i;if(e.has("EXT_texture_filter_anisotropic")===!0){let x=e.get("EXT_texture_filter_anisotropic");i=s.getParameter(x.MAX_TEXTURE_MAX_ANISOTROPY_EXT)}else i=0;return i}function o(x){return!(x!==Dn&&n.convert(x)!==s.getParameter(s.IMPLEMENTATION_COLOR_READ_FORMAT))}function a(x){let w=x===bn&&(e.has("EXT_color_buffer_half_float")||e.has("EXT_color_buffer_float"));return!(x!==pn&&x!==_n&&!w&&n.convert(x)!==s.getParameter(s.IMPLEMENTATION_COLOR_READ_TYPE))}function l(x){if(x==="highp"){if(s.getShaderPrecisionFormat(s.VERTEX_SHADER,s.HIGH_FLOAT).precision>0&&s.getShaderPrecisionFormat(s.FRAGMENT_SHADER,s.HIGH_FLOAT).precision>0)return"highp";x="mediump"}return x==="mediump"&&s.getShaderPrecisionFormat(s.VERTEX_SHADER,s.MEDIUM_FLOAT).precision>0&&s.getShaderPrecisionFormat(s.FRAGMENT_SHADER,s.MEDIUM_FLOAT).precision>0?"mediump":"lowp"}let c=t.precision!==void 0?t.precision:"highp",h=l(c);h!==c&&(Ee("WebGLRenderer:",c,"not supported, using",h,"instead."),c=h);let u=t.reversedDepthBuffer===!0&&e.has("EXT_clip_control"),d=t.logarithmicDepthBuffer===!0&&u===!1;t.reversedDepthBuffer===!0&&u===!1&&Ee("WebGLRenderer: Unable to use reversed depth buffer due to missing EXT_clip_control extension. Fallback to default depth buffer."),t.logarithmicDepthBuffer===!0&&u===!0&&Ee("WebGLRenderer: Logarithmic depth buffer is ignored when reversed depth buffer is enabled.");let f=s.getParameter(s.MAX_TEXTURE_IMAGE_UNITS),g=s.getParameter(s.MAX_VERTEX_TEXTURE_IMAGE_UNITS),y=s.getParameter(s.MAX_TEXTURE_SIZE),p=s.getParameter(s.MAX_CUBE_MAP_TEXTURE_SIZE),m=s.getParameter(s.MAX_VERTEX_ATTRIBS),b=s.getParameter(s.MAX_VERTEX_UNIFORM_VECTORS),E=s.getParameter(s.MAX_VARYING_VECTORS),M=s.getParameter(s.MAX_FRAGMENT_UNIFORM_VECTORS),R=s.getParameter(s.MAX_SAMPLES),T=s.getParameter(s.SAMPLES);return{isWebGL2:!0,getMaxAnisotropy:r,getMaxPrecision:l,textureFormatReadable:o,textureTypeReadable:a,precision:c,logarithmicDepthBuffer:d,reversedDepthBuffer:u,maxTextures:f,maxVertexTextures:g,maxTextureSize:y,maxCubemapSize:p,maxAttributes:m,maxVertexUniforms:b,maxVaryings:E,maxFragmentUniforms:M,maxSamples:R,samples:T}}function Kv(s){let e=this,t=null,n=0,i=!1,r=!1,o=new $t,a=new Fe,l={value:null,needsUpdate:!1};this.uniform=l,this.numPlanes=0,this.numIntersection=0,this.init=function(u,d){let f=u.length!==0||d||n!==0||i;return i=d,n=u.length,f},this.beginShadows=function(){r=!0,h(null)},this.endShadows=function(){r=!1},this.setGlobalState=function(u,d){t=h(u,d,0)},this.setState=function(u,d,f){let g=u.clippingPlanes,y=u.clipIntersection,p=u.clipShadows,m=s.get(u);if(!i||g===null||g.length===0||r&&!p)r?h(null):c();else{let b=r?0:n,E=b*4,M=m.clippingState||null;l.value=M,M=h(g,d,E,f);for(let R=0;R!==E;++R)M[R]=t[R];m.clippingState=M,this.numIntersection=y?this.numPlanes:0,this.numPlanes+=b}};function c(){l.value!==t&&(l.value=t,l.needsUpdate=n>0),e.numPlanes=n,e.numIntersection=0}function h(u,d,f,g){let y=u!==null?u.length:0,p=null;if(y!==0){if(p=l.value,g!==!0||p===null){let m=f+y*4,b=d.matrixWorldInverse;a.getNormalMatrix(b),(p===null||p.length<m)&&(p=new Float32Array(m));for(let E=0,M=f;E!==y;++E,M+=4)o.copy(u[E]).applyMatrix4(b,a),o.normal.toArray(p,M),p[M+3]=o.constant}l.value=p,l.needsUpdate=!0}return e.numPlanes=y,e.numIntersection=0,p}}var Lo=class extends Tt{constructor(e=1,t={}){super(e,e,t),this.isWebGLCubeRenderTarget=!0;let n={width:e,height:e,depth:1},i=[n,n,n,n,n,n];this.texture=new ro(i),this._setTextureOptions(t),this.texture.isRenderTargetTexture=!0}fromEquirectangularTexture(e,t){this.texture.type=t.type,this.texture.colorSpace=t.colorSpace,this.texture.generateMipmaps=t.generateMipmaps,this.texture.minFilter=t.minFilter,this.texture.magFilter=t.magFilter;let n={uniforms:{tEquirect:{value:null}},vertexShader:`

				varying vec3 vWorldDirection;

				vec3 transformDirection( in vec3 dir, in mat4 matrix ) {

					return normalize( ( matrix * vec4( dir, 0.0 ) ).xyz );

				}

				void main() {

					vWorldDirection = transformDirection( position, modelMatrix );

					#include <begin_vertex>
					#include <project_vertex>

				}
			`,fragmentShader:`

				uniform sampler2D tEquirect;

				varying vec3 vWorldDirection;

				#include <common>

				void main() {

					vec3 direction = normalize( vWorldDirection );

					vec2 sampleUV = equirectUv( direction );

					gl_FragColor = texture2D( tEquirect, sampleUV );

				}
			`},i=new ln(5,5,5),r=new dn({name:"CubemapFromEquirect",uniforms:Es(n.uniforms),vertexShader:n.vertexShader,fragmentShader:n.fragmentShader,side:Kt,blending:Ms});r.uniforms.tEquirect.value=t;let o=new ue(i,r),a=t.minFilter;return t.minFilter===Ln&&(t.minFilter=St),new gr(1,10,this).update(e,o),t.minFilter=a,o.geometry.dispose(),o.material.dispose(),this}clear(e,t=!0,n=!0,i=!0){let r=e.getRenderTarget();for(let o=0;o<6;o++)e.setRenderTarget(this,o),e.clear(t,n,i);e.setRenderTarget(r)}},Ep=256,jv=3,Zv=20,jp=256,Zp=16,Jv=3,Qv=new S,e_=new ve,Tr=class s{constructor(e){this._renderer=e,this._cubeSize=0,this._sourceTarget=null,this._cubeCamera=new gr(1,10,null),this._boxMesh=new ue(new ln(5,5,5),null),this._cubemapMaterial=null,this._equirectMaterial=null,this._blurMaterial=null,this._ggxMaterial=null,this._integrationMaterial=null}fromScene(e,t=0,n=.1,i=100,r={}){let{size:o=256,position:a=Qv}=r,l=this._renderer;this._setSize(o);let c=this._allocateTarget(),h=this._getSourceTarget(!0);t>0&&(h.texture.mipmapsAutoUpdate=!1);let u=l.autoClear,d=l.autoClearColor,f=l.autoClearDepth,g=l.autoClearStencil,y=e.background;l.autoClear=!0,l.autoClearColor=!0,l.autoClearDepth=!0,l.autoClearStencil=!0,y===null&&(e.background=l.getClearColor(e_));let p=new gr(n,i,h);return p.position.copy(a),p.update(l,e),l.autoClear=u,l.autoClearColor=d,l.autoClearDepth=f,l.autoClearStencil=g,e.background=y,t>0&&(h.texture.mipmapsAutoUpdate=!0,this._blur(c,t)),this._applyPMREM(c),c}fromEquirectangular(e,t=null){return this._fromTexture(e,t)}fromCubemap(e,t=null){return this._fromTexture(e,t)}compileCubemapShader(){this._cubemapMaterial===null&&(this._cubemapMaterial=Pp(),this._compileMaterial(this._cubemapMaterial))}compileEquirectangularShader(){this._equirectMaterial===null&&(this._equirectMaterial=Cp(),this._compileMaterial(this._equirectMaterial))}dispose(){this._sourceTarget!==null&&this._sourceTarget.dispose(),this._cubemapMaterial!==null&&this._cubemapMaterial.dispose(),this._equirectMaterial!==null&&this._equirectMaterial.dispose(),this._blurMaterial!==null&&this._blurMaterial.dispose(),this._ggxMaterial!==null&&this._ggxMaterial.dispose(),this._integrationMaterial!==null&&this._integrationMaterial.dispose(),this._boxMesh.geometry.dispose()}static lodToRoughness(e,t){return t>0?1-Math.sqrt(1-e/t):0}_setSize(e){this._cubeSize=Math.max(Ep,_u(e))}_fromTexture(e,t){e.mapping===Ss||e.mapping===_r?this._setSize(e.image.length===0?Ep:e.image[0].width||e.image[0].image.width):this._setSize(e.image.width/4);let n=t||this._allocateTarget();return this._textureToCubemap(e),this._applyPMREM(n),n}_allocateTarget(){let e=this._cubeSize,t=Rp(e,!1,!1),n=Math.log2(e)-jv;for(let i=0;i<=n;i++)t.texture.mipmaps.push({width:e>>i,height:e>>i});return t.texture.name="PMREM",t.texture.isPMREMTexture=!0,t}_getSourceTarget(e=!1){let t=this._cubeSize,n=this._sourceTarget;return(n===null||n.width!==t||e&&n.depthBuffer===!1)&&(n!==null&&n.dispose(),this._sourceTarget=Rp(t,!0,e)),this._sourceTarget}_compileMaterial(e){this._boxMesh.material=e,this._renderer.compile(this._boxMesh,this._cubeCamera.children[0])}_renderCube(e,t,n){let i=this._boxMesh,r=this._cubeCamera;i.material=n,r.renderTarget=e,r.activeMipmapLevel=t;let o=e.width>>t;e.viewport.set(0,0,o,o),r.update(this._renderer,i),e.viewport.set(0,0,e.width,e.height)}_textureToCubemap(e){let t;e.mapping===Ss||e.mapping===_r?(this._cubemapMaterial===null&&(this._cubemapMaterial=Pp()),t=this._cubemapMaterial,t.uniforms.flipEnvMap.value=e.isRenderTargetTexture===!1?-1:1):(this._equirectMaterial===null&&(this._equirectMaterial=Cp()),t=this._equirectMaterial),t.uniforms.envMap.value=e,this._renderCube(this._getSourceTarget(),0,t)}_applyPMREM(e){this._ggxMaterial===null&&(this._ggxMaterial=t_(),this._integrationMaterial=n_());let t=this._cubeSize,n=e.texture.mipmaps.length-1,i=this._ggxMaterial.uniforms;i.envMap.value=this._sourceTarget.texture;let r=this._integrationMaterial.uniforms;r.envMap.value=this._sourceTarget.texture,r.sourceLod.value=Math.log2(t/Zp);for(let o=0;o<=n;o++){let a=s.lodToRoughness(o,n);if(o>n-Jv)r.roughness.value=a,this._renderCube(e,o,this._integrationMaterial);else{let l=a>0?Math.log2(t)+.5*Math.log2(6/(jp*Math.pow(a,4)))+.5:0;i.roughness.value=a,i.lodBias.value=l,this._renderCube(e,o,this._ggxMaterial)}}}_blur(e,t){this._blurMaterial===null&&(this._blurMaterial=i_());let n=this._blurMaterial,i=n.uniforms,r=this._sourceTarget;i.sigma.value=Math.min(t,Math.PI)/Math.SQRT2,i.envMap.value=r.texture,this._renderCube(e,0,n),i.envMap.value=e.texture,this._renderCube(r,0,n)}};function Rp(s,e,t){return new Lo(s,{minFilter:Ln,generateMipmaps:e,type:bn,colorSpace:an,depthBuffer:t})}function Do(s,e,t){return new dn({name:s,uniforms:e,vertexShader:We.cube_vert,fragmentShader:t,side:Kt,blending:Ms,depthTest:!1,depthWrite:!1})}function t_(){return Do("PMREMGGXConvolution",{envMap:{value:null},roughness:{value:0},lodBias:{value:0}},`

		#define GGX_SAMPLES ${jp}u

		varying vec3 vWorldDirection;

		uniform samplerCube envMap;
		uniform float roughness;
		uniform float lodBias;

		#include <common>

		// Van der Corput radical inverse
		float radicalInverse_VdC( uint bits ) {

			bits = ( bits << 16u ) | ( bits >> 16u );
			bits = ( ( bits & 0x55555555u ) << 1u ) | ( ( bits & 0xAAAAAAAAu ) >> 1u );
			bits = ( ( bits & 0x33333333u ) << 2u ) | ( ( bits & 0xCCCCCCCCu ) >> 2u );
			bits = ( ( bits & 0x0F0F0F0Fu ) << 4u ) | ( ( bits & 0xF0F0F0F0u ) >> 4u );
			bits = ( ( bits & 0x00FF00FFu ) << 8u ) | ( ( bits & 0xFF00FF00u ) >> 8u );
			return float( bits ) * 2.3283064365386963e-10; // / 0x100000000

		}

		// Hammersley sequence
		vec2 hammersley( uint i, uint N ) {

			return vec2( float( i ) / float( N ), radicalInverse_VdC( i ) );

		}

		void main() {

			vec3 N = normalize( vWorldDirection );

			// For very low roughness, just sample the environment directly
			if ( roughness < 0.001 ) {

				gl_FragColor = vec4( textureLod( envMap, N, 0.0 ).rgb, 1.0 );
				return;

			}

			float alpha = roughness * roughness;
			float alpha2 = alpha * alpha;

			// Tangent space basis for VNDF sampling
			vec3 up = abs( N.z ) < 0.999 ? vec3( 0.0, 0.0, 1.0 ) : vec3( 1.0, 0.0, 0.0 );
			vec3 tangent = normalize( cross( up, N ) );
			vec3 bitangent = cross( N, tangent );

			vec3 prefilteredColor = vec3( 0.0 );
			float totalWeight = 0.0;

			for ( uint i = 0u; i < GGX_SAMPLES; i ++ ) {

				vec2 Xi = hammersley( i, GGX_SAMPLES );

				// With V = N, sample the reflected direction directly.
				float invQ = 1.0 / ( 1.0 - Xi.x + alpha2 * Xi.x );
				float NdotL = ( 1.0 - Xi.x - alpha2 * Xi.x ) * invQ;

				if ( NdotL > 0.0 ) {

					float phi = 2.0 * PI * Xi.y;
					float sinTheta = 2.0 * alpha * sqrt( Xi.x * ( 1.0 - Xi.x ) ) * invQ;
					vec3 L = N * NdotL + ( tangent * cos( phi ) + bitangent * sin( phi ) ) * sinTheta;

					// Match the source mip to the sample's solid angle. The terms
					// independent of the sample are precomputed in lodBias.
					float d = alpha2 * invQ;
					float lod = max( log2( d ) + lodBias, 0.0 );

					// Weight by NdotL for the split-sum approximation
					prefilteredColor += textureLod( envMap, L, lod ).rgb * NdotL;
					totalWeight += NdotL;

				}

			}

			gl_FragColor = vec4( prefilteredColor / totalWeight, 1.0 );

		}
	`)}function n_(){return Do("PMREMGGXIntegration",{envMap:{value:null},roughness:{value:0},sourceLod:{value:0},sourceSize:{value:Zp}},`

		varying vec3 vWorldDirection;

		uniform samplerCube envMap;
		uniform float roughness;
		uniform float sourceLod;
		uniform int sourceSize;

		void main() {

			vec3 N = normalize( vWorldDirection );

			float alpha = roughness * roughness;
			float alpha2 = alpha * alpha;

			float texelSize = 2.0 / float( sourceSize );

			vec3 prefilteredColor = vec3( 0.0 );
			float totalWeight = 0.0;

			// Pair opposite texels: only the one in N's hemisphere contributes.
			for ( int face = 0; face < 3; face ++ ) {

				for ( int y = 0; y < sourceSize; y ++ ) {

					for ( int x = 0; x < sourceSize; x ++ ) {

						vec2 uv = ( vec2( x, y ) + 0.5 ) * texelSize - 1.0;
						vec3 texelDirection = face == 0 ? vec3( 1.0, uv ) : ( face == 1 ? vec3( uv.x, 1.0, uv.y ) : vec3( uv, 1.0 ) );

						float invDistance = inversesqrt( 1.0 + dot( uv, uv ) );
						float NdotL = dot( N, texelDirection );
						texelDirection *= NdotL < 0.0 ? - 1.0 : 1.0;
						NdotL = abs( NdotL ) * invDistance;

						// With V = N, NdotH squared is ( 1 + NdotL ) / 2. Common factors
						// in the GGX distribution and texel solid angle cancel when normalized.
						float d = 1.0 + alpha2 + ( alpha2 - 1.0 ) * NdotL;
						float weight = NdotL * invDistance * invDistance * invDistance / ( d * d );

						prefilteredColor += textureLod( envMap, texelDirection, sourceLod ).rgb * weight;
						totalWeight += weight;

					}

				}

			}

			gl_FragColor = vec4( prefilteredColor / totalWeight, 1.0 );

		}
	`)}function i_(){return Do("PMREMSphericalGaussianBlur",{envMap:{value:null},sigma:{value:0}},`

		#define SAMPLES ${Zv}
		#define GOLDEN_ANGLE 2.39996322973

		varying vec3 vWorldDirection;

		uniform samplerCube envMap;
		uniform float sigma;

		#include <common>

		void main() {

			vec3 outputDirection = normalize( vWorldDirection );

			vec3 up = abs( outputDirection.z ) < 0.999 ? vec3( 0.0, 0.0, 1.0 ) : vec3( 1.0, 0.0, 0.0 );
			vec3 tangent = normalize( cross( up, outputDirection ) );
			vec3 bitangent = cross( outputDirection, tangent );

			// Truncate the kernel at three standard deviations or at the antipode.
			float thetaMax = min( 3.0 * sigma, PI );
			float truncation = 1.0 - exp( - 0.5 * thetaMax * thetaMax / ( sigma * sigma ) );

			vec3 accumColor = vec3( 0.0 );
			float accumWeight = 0.0;

			for ( int i = 0; i < SAMPLES; i ++ ) {

				// Stratified inverse-CDF sampling of the Gaussian, placed on a golden-angle spiral.
				float stratum = ( float( i ) + 0.5 ) / float( SAMPLES );
				float theta = sigma * sqrt( - 2.0 * log( 1.0 - stratum * truncation ) );
				float phi = float( i ) * GOLDEN_ANGLE;

				vec3 offset = cos( phi ) * tangent + sin( phi ) * bitangent;
				vec3 sampleDirection = cos( theta ) * outputDirection + sin( theta ) * offset;

				// Correct the planar sample density to solid angle.
				float weight = sin( theta ) / theta;

				accumColor += weight * textureLod( envMap, sampleDirection, 0.0 ).rgb;
				accumWeight += weight;

			}

			gl_FragColor = vec4( accumColor / accumWeight, 1.0 );

		}
	`)}function Cp(){return Do("PMREMEquirectangularToCubemap",{envMap:{value:null}},`

		varying vec3 vWorldDirection;

		uniform sampler2D envMap;

		#include <common>

		void main() {

			// Average four subpixel samples to preserve small, bright features.
			vec3 direction = normalize( vWorldDirection );
			vec3 dx = dFdx( direction ) * 0.25;
			vec3 dy = dFdy( direction ) * 0.25;

			vec3 color = textureLod( envMap, equirectUv( normalize( direction - dx - dy ) ), 0.0 ).rgb;
			color += textureLod( envMap, equirectUv( normalize( direction + dx - dy ) ), 0.0 ).rgb;
			color += textureLod( envMap, equirectUv( normalize( direction - dx + dy ) ), 0.0 ).rgb;
			color += textureLod( envMap, equirectUv( normalize( direction + dx + dy ) ), 0.0 ).rgb;
			gl_FragColor = vec4( color * 0.25, 1.0 );

		}
	`)}function Pp(){return Do("PMREMCubemapToCubemap",{envMap:{value:null},flipEnvMap:{value:-1}},`

		varying vec3 vWorldDirection;

		uniform samplerCube envMap;
		uniform float flipEnvMap;

		void main() {

			gl_FragColor = vec4( textureCube( envMap, vec3( flipEnvMap * vWorldDirection.x, vWorldDirection.yz ) ).rgb, 1.0 );

		}
	`)}function s_(s){let e=new WeakMap,t=new WeakMap,n=null;function i(d,f=!1){return d==null?null:f?o(d):r(d)}function r(d){if(d&&d.isTexture){let f=d.mapping;if(f===Qa||f===el)if(e.has(d)){let g=e.get(d).texture;return a(g,d.mapping)}else{let g=d.image;if(g&&g.height>0){let y=new Lo(g.height);return y.fromEquirectangularTexture(s,d),e.set(d,y),d.addEventListener("dispose",c),a(y.texture,d.mapping)}else return null}}return d}function o(d){if(d&&d.isTexture&&d.isPMREMTexture!==!0){let f=d.mapping,g=f===Qa||f===el,y=f===Ss||f===_r;if(g||y){let p=t.get(d),m=p!==void 0?p.texture.pmremVersion:0;if(d.isRenderTargetTexture&&d.pmremVersion!==m)return n===null&&(n=new Tr(s)),p=g?n.fromEquirectangular(d,p):n.fromCubemap(d,p),p.texture.pmremVersion=d.pmremVersion,t.set(d,p),p.texture;if(p!==void 0)return p.texture;{let b=d.image;return g&&b&&b.height>0||y&&b&&l(b)?(n===null&&(n=new Tr(s)),p=g?n.fromEquirectangular(d):n.fromCubemap(d),p.texture.pmremVersion=d.pmremVersion,t.set(d,p),d.addEventListener("dispose",h),p.texture):null}}}return d}function a(d,f){return f===Qa?d.mapping=Ss:f===el&&(d.mapping=_r),d}function l(d){let f=0,g=6;for(let y=0;y<g;y++)d[y]!==void 0&&f++;return f===g}function c(d){let f=d.target;f.removeEventListener("dispose",c);let g=e.get(f);g!==void 0&&(e.delete(f),g.dispose())}function h(d){let f=d.target;f.removeEventListener("dispose",h);let g=t.get(f);g!==void 0&&(t.delete(f),g.dispose())}function u(){e=new WeakMap,t=new WeakMap,n!==null&&(n.dispose(),n=null)}return{get:i,dispose:u}}function r_(s){let e={};function t(n){if(e[n]!==void 0)return e[n];let i=s.getExtension(n);return e[n]=i,i}return{has:function(n){return t(n)!==null},init:function(){t("EXT_color_buffer_float"),t("WEBGL_clip_cull_distance"),t("OES_texture_float_linear"),t("EXT_color_buffer_half_float"),t("WEBGL_multisampled_render_to_texture"),t("WEBGL_render_shared_exponent")},get:function(n){let i=t(n);return i===null&&hs("WebGLRenderer: "+n+" extension not supported."),i}}}function o_(s,e,t,n){let i={},r=new WeakMap,o=new FinalizationRegistry(g=>delete i[g]);function a(g){l(g.target)}function l(g){g.index!==null&&e.remove(g.index);for(let p in g.attributes)e.remove(g.attributes[p]);g.removeEventListener("dispose",a),delete i[g.id],o.unregister(g);let y=r.get(g);y&&(e.remove(y),r.delete(g)),n.releaseStatesOfGeometry(g),g.isInstancedBufferGeometry===!0&&delete g._maxInstanceCount,t.memory.geometries--}function c(g,y){return i[y.id]!==void 0||(y.addEventListener("dispose",a),i[y.id]=new WeakRef(y),o.register(y,y.id,y),t.memory.geometries++),y}function h(g){let y=g.attributes;for(let p in y)e.update(y[p],s.ARRAY_BUFFER)}function u(g){let y=g.index,p=g.attributes.position,m=0;if(p===void 0)return;let b=y!==null?y.array.length:p.array.length/3-1,E=p.count>=65535?eo:Qr,M=new E(Math.ceil(b/3)*6,1),R=M.array;if(y!==null){let x=y.array;m=y.version;for(let w=0,O=0;w<b;w+=3){let I=x[w+0],N=x[w+1],k=x[w+2];R[O++]=I,R[O++]=N,R[O++]=N,R[O++]=k,R[O++]=k,R[O++]=I}}else{m=p.version;for(let x=0,w=0;x<b;x+=3){let O=x+0,I=x+1,N=x+2;R[w++]=O,R[w++]=I,R[w++]=I,R[w++]=N,R[w++]=N,R[w++]=O}}M.version=m;let T=r.get(g);T&&e.remove(T),r.set(g,M)}function d(g){let y=r.get(g);if(y){let p=g.index;p!==null&&y.version<p.version&&u(g)}else u(g);return r.get(g)}function f(){for(let g in i){let y=i[g].deref();y!==void 0&&l(y)}}return{get:c,update:h,getWireframeAttribute:d,dispose:f}}function a_(s,e,t){let n;function i(u){n=u}let r,o;function a(u){r=u.type,o=u.bytesPerElement}function l(u,d){s.drawElements(n,d,r,u*o),t.update(d,n,1)}function c(u,d,f){f!==0&&(s.drawElementsInstanced(n,d,r,u*o,f),t.update(d,n,f))}function h(u,d,f){if(f===0)return;e.get("WEBGL_multi_draw").multiDrawElementsWEBGL(n,d,0,r,u,0,f);let y=0;for(let p=0;p<f;p++)y+=d[p];t.update(y,n,1)}this.setMode=i,this.setIndex=a,this.render=l,this.renderInstances=c,this.renderMultiDraw=h}function l_(s){let e={geometries:0,textures:0},t={frame:0,calls:0,triangles:0,points:0,lines:0};function n(r,o,a){switch(t.calls++,o){case s.TRIANGLES:t.triangles+=a*(r/3);break;case s.LINES:t.lines+=a*(r/2);break;case s.LINE_STRIP:t.lines+=a*(r-1);break;case s.LINE_LOOP:t.lines+=a*r;break;case s.POINTS:t.points+=a*r;break;default:Oe("WebGLInfo: Unknown draw mode:",o);break}}function i(){t.calls=0,t.triangles=0,t.points=0,t.lines=0}return{memory:e,render:t,programs:null,autoReset:!0,reset:i,update:n}}function c_(s,e,t){let n=new WeakMap,i=new at;function r(o,a,l){let c=o.morphTargetInfluences,h=a.morphAttributes.position||a.morphAttributes.normal||a.morphAttributes.color,u=h!==void 0?h.length:0,d=n.get(a);if(d===void 0||d.count!==u){let O=function(){x.dispose(),n.delete(a),a.removeEventListener("dispose",O)};d!==void 0&&d.texture.dispose();let f=a.morphAttributes.position!==void 0,g=a.morphAttributes.normal!==void 0,y=a.morphAttributes.color!==void 0,p=a.morphAttributes.position||[],m=a.morphAttributes.normal||[],b=a.morphAttributes.color||[],E=0;f===!0&&(E=1),g===!0&&(E=2),y===!0&&(E=3);let M=a.attributes.position.count*E,R=1;M>e.maxTextureSize&&(R=Math.ceil(M/e.maxTextureSize),M=e.maxTextureSize);let T=new Float32Array(M*R*4*u),x=new Jr(T,M,R,u);x.type=_n,x.needsUpdate=!0;let w=E*4;for(let I=0;I<u;I++){let N=p[I],k=m[I],V=b[I],P=M*R*4*I;for(let G=0;G<N.count;G++){let q=G*w;f===!0&&(i.fromBufferAttribute(N,G),T[P+q+0]=i.x,T[P+q+1]=i.y,T[P+q+2]=i.z,T[P+q+3]=0),g===!0&&(i.fromBufferAttribute(k,G),T[P+q+4]=i.x,T[P+q+5]=i.y,T[P+q+6]=i.z,T[P+q+7]=0),y===!0&&(i.fromBufferAttribute(V,G),T[P+q+8]=i.x,T[P+q+9]=i.y,T[P+q+10]=i.z,T[P+q+11]=V.itemSize===4?i.w:1)}}d={count:u,texture:x,size:new ye(M,R)},n.set(a,d),a.addEventListener("dispose",O)}if(o.isInstancedMesh===!0&&o.morphTexture!==null)l.getUniforms().setValue(s,"morphTexture",o.morphTexture,t);else{let f=0;for(let y=0;y<c.length;y++)f+=c[y];let g=a.morphTargetsRelative?1:1-f;l.getUniforms().setValue(s,"morphTargetBaseInfluence",g),l.getUniforms().setValue(s,"morphTargetInfluences",c)}l.getUniforms().setValue(s,"morphTargetsTexture",d.texture,t),l.getUniforms().setValue(s,"morphTargetsTextureSize",d.size)}return{update:r}}function h_(s,e,t,n,i){let r=new WeakMap;function o(c){let h=i.render.frame,u=c.geometry,d=e.get(c,u);if(r.get(d)!==h&&(e.update(d),r.set(d,h)),c.isInstancedMesh&&(c.hasEventListener("dispose",l)===!1&&c.addEventListener("dispose",l),r.get(c)!==h&&(t.update(c.instanceMatrix,s.ARRAY_BUFFER),c.instanceColor!==null&&t.update(c.instanceColor,s.ARRAY_BUFFER),r.set(c,h))),c.isSkinnedMesh){let f=c.skeleton;r.get(f)!==h&&(f.update(),r.set(f,h))}return d}function a(){r=new WeakMap}function l(c){let h=c.target;h.removeEventListener("dispose",l),n.releaseStatesOfObject(h),t.remove(h.instanceMatrix),h.instanceColor!==null&&t.remove(h.instanceColor)}return{update:o,dispose:a}}var u_={[eu]:"LINEAR_TONE_MAPPING",[tu]:"REINHARD_TONE_MAPPING",[nu]:"CINEON_TONE_MAPPING",[iu]:"ACES_FILMIC_TONE_MAPPING",[ru]:"AGX_TONE_MAPPING",[bo]:"NEUTRAL_TONE_MAPPING",[su]:"CUSTOM_TONE_MAPPING"};function d_(s,e,t,n,i,r){let o=new Tt(e,t,{type:s,depthBuffer:i,stencilBuffer:r,samples:n?4:0,storeMultisampledDepthBuffer:!1,storeMultisampledStencilBuffer:!1,resolveDepthBuffer:!1,resolveStencilBuffer:!1}),a=null,l=null,c=null,h=new Ye;h.setAttribute("position",new Ue([-1,3,0,-1,-1,0,3,-1,0],3)),h.setAttribute("uv",new Ue([0,2,0,0,2,0],2));let u=new Ha({uniforms:{tDiffuse:{value:null}},vertexShader:`
			precision highp float;

			uniform mat4 modelViewMatrix;
			uniform mat4 projectionMatrix;

			attribute vec3 position;
			attribute vec2 uv;

			varying vec2 vUv;

			void main() {
				vUv = uv;
				gl_Position = projectionMatrix * modelViewMatrix * vec4( position, 1.0 );
			}`,fragmentShader:`
			precision highp float;

			uniform sampler2D tDiffuse;

			varying vec2 vUv;

			#include <tonemapping_pars_fragment>
			#include <colorspace_pars_fragment>

			void main() {
				gl_FragColor = texture2D( tDiffuse, vUv );

				#ifdef LINEAR_TONE_MAPPING
					gl_FragColor.rgb = LinearToneMapping( gl_FragColor.rgb );
				#elif defined( REINHARD_TONE_MAPPING )
					gl_FragColor.rgb = ReinhardToneMapping( gl_FragColor.rgb );
				#elif defined( CINEON_TONE_MAPPING )
					gl_FragColor.rgb = CineonToneMapping( gl_FragColor.rgb );
				#elif defined( ACES_FILMIC_TONE_MAPPING )
					gl_FragColor.rgb = ACESFilmicToneMapping( gl_FragColor.rgb );
				#elif defined( AGX_TONE_MAPPING )
					gl_FragColor.rgb = AgXToneMapping( gl_FragColor.rgb );
				#elif defined( NEUTRAL_TONE_MAPPING )
					gl_FragColor.rgb = NeutralToneMapping( gl_FragColor.rgb );
				#elif defined( CUSTOM_TONE_MAPPING )
					gl_FragColor.rgb = CustomToneMapping( gl_FragColor.rgb );
				#endif

				#ifdef SRGB_TRANSFER
					gl_FragColor = sRGBTransferOETF( gl_FragColor );
				#endif
			}`,depthTest:!1,depthWrite:!1}),d=new ue(h,u),f=new Gn(-1,1,1,-1,0,1),g=null,y=null,p=!1,m,b=null,E=[],M=!1;this.setSize=function(R,T){o.setSize(R,T),a!==null&&a.setSize(R,T),l!==null&&l.setSize(R,T);for(let x=0;x<E.length;x++){let w=E[x];w.setSize&&w.setSize(R,T)}},this.setEffects=function(R){E=R,M=E.length>0&&E[0].isRenderPass===!0;let T=o.width,x=o.height;E.length>0&&a===null&&(a=new Tt(T,x,{type:bn,depthBuffer:!1,stencilBuffer:!1}),l=new Tt(T,x,{type:bn,depthBuffer:!1,stencilBuffer:!1}));let w=i===!0&&E.some(O=>O.needsDepthTexture===!0);w!==(o.depthTexture!==null)&&(w===!0&&c===null&&(c=new zn(T,x),r===!0&&(c.format=Ei,c.type=As)),o.dispose(),o.depthTexture=w?c:null,o.resolveDepthBuffer=w,o.storeMultisampledDepthBuffer=w);for(let O=0;O<E.length;O++){let I=E[O];I.setSize&&I.setSize(T,x),w&&I.needsDepthTexture===!0&&I.setDepthTexture&&I.setDepthTexture(c)}},this.begin=function(R,T){if(p||R.toneMapping===ti&&E.length===0)return!1;if(b=T,T!==null){let x=T.width,w=T.height;(o.width!==x||o.height!==w)&&this.setSize(x,w)}return M===!1&&R.setRenderTarget(o),m=R.toneMapping,R.toneMapping=ti,!0},this.hasRenderPass=function(){return M},this.end=function(R,T){R.toneMapping=m,p=!0;let x=o,w=a;for(let O=0;O<E.length;O++){let I=E[O];I.enabled!==!1&&(I.render(R,w,x,T),I.needsSwap!==!1&&(x=w,w=w===a?l:a))}if(g!==R.outputColorSpace||y!==R.toneMapping){g=R.outputColorSpace,y=R.toneMapping,u.defines={},Xe.getTransfer(g)===nt&&(u.defines.SRGB_TRANSFER="");let O=u_[y];O&&(u.defines[O]=""),u.needsUpdate=!0}u.uniforms.tDiffuse.value=x.texture,R.setRenderTarget(b),R.render(d,f),b=null,p=!1},this.isCompositing=function(){return p},this.dispose=function(){o.dispose(),a!==null&&a.dispose(),l!==null&&l.dispose(),h.dispose(),u.dispose()}}var Jp=new Nt,Qp=new zn(1,1),em=new oo(1),tm=new Jr,nm=new Fa,im=new ro,Ip=[],Lp=[],Dp=new Float32Array(16),Np=new Float32Array(9),Op=new Float32Array(4);function Er(s,e,t){let n=s[0];if(n<=0||n>0)return s;let i=e*t,r=Ip[i];if(r===void 0&&(r=new Float32Array(i),Ip[i]=r),e!==0){n.toArray(r,0);for(let o=1,a=0;o!==e;++o)a+=t,s[o].toArray(r,a)}return r}function Ut(s,e){if(s.length!==e.length)return!1;for(let t=0,n=s.length;t<n;t++)if(s[t]!==e[t])return!1;return!0}function Ft(s,e){for(let t=0,n=e.length;t<n;t++)s[t]=e[t]}function Gl(s,e){let t=Lp[e];t===void 0&&(t=new Int32Array(e),Lp[e]=t);for(let n=0;n!==e;++n)t[n]=s.allocateTextureUnit();return t}function f_(s,e){let t=this.cache;t[0]!==e&&(s.uniform1f(this.addr,e),t[0]=e)}function p_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y)&&(s.uniform2f(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Ut(t,e))return;s.uniform2fv(this.addr,e),Ft(t,e)}}function m_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z)&&(s.uniform3f(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else if(e.r!==void 0)(t[0]!==e.r||t[1]!==e.g||t[2]!==e.b)&&(s.uniform3f(this.addr,e.r,e.g,e.b),t[0]=e.r,t[1]=e.g,t[2]=e.b);else{if(Ut(t,e))return;s.uniform3fv(this.addr,e),Ft(t,e)}}function g_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z||t[3]!==e.w)&&(s.uniform4f(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Ut(t,e))return;s.uniform4fv(this.addr,e),Ft(t,e)}}function x_(s,e){let t=this.cache,n=e.elements;if(n===void 0){if(Ut(t,e))return;s.uniformMatrix2fv(this.addr,!1,e),Ft(t,e)}else{if(Ut(t,n))return;Op.set(n),s.uniformMatrix2fv(this.addr,!1,Op),Ft(t,n)}}function y_(s,e){let t=this.cache,n=e.elements;if(n===void 0){if(Ut(t,e))return;s.uniformMatrix3fv(this.addr,!1,e),Ft(t,e)}else{if(Ut(t,n))return;Np.set(n),s.uniformMatrix3fv(this.addr,!1,Np),Ft(t,n)}}function v_(s,e){let t=this.cache,n=e.elements;if(n===void 0){if(Ut(t,e))return;s.uniformMatrix4fv(this.addr,!1,e),Ft(t,e)}else{if(Ut(t,n))return;Dp.set(n),s.uniformMatrix4fv(this.addr,!1,Dp),Ft(t,n)}}function __(s,e){let t=this.cache;t[0]!==e&&(s.uniform1i(this.addr,e),t[0]=e)}function b_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y)&&(s.uniform2i(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Ut(t,e))return;s.uniform2iv(this.addr,e),Ft(t,e)}}function M_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z)&&(s.uniform3i(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else{if(Ut(t,e))return;s.uniform3iv(this.addr,e),Ft(t,e)}}function w_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z||t[3]!==e.w)&&(s.uniform4i(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Ut(t,e))return;s.uniform4iv(this.addr,e),Ft(t,e)}}function S_(s,e){let t=this.cache;t[0]!==e&&(s.uniform1ui(this.addr,e),t[0]=e)}function T_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y)&&(s.uniform2ui(this.addr,e.x,e.y),t[0]=e.x,t[1]=e.y);else{if(Ut(t,e))return;s.uniform2uiv(this.addr,e),Ft(t,e)}}function A_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z)&&(s.uniform3ui(this.addr,e.x,e.y,e.z),t[0]=e.x,t[1]=e.y,t[2]=e.z);else{if(Ut(t,e))return;s.uniform3uiv(this.addr,e),Ft(t,e)}}function E_(s,e){let t=this.cache;if(e.x!==void 0)(t[0]!==e.x||t[1]!==e.y||t[2]!==e.z||t[3]!==e.w)&&(s.uniform4ui(this.addr,e.x,e.y,e.z,e.w),t[0]=e.x,t[1]=e.y,t[2]=e.z,t[3]=e.w);else{if(Ut(t,e))return;s.uniform4uiv(this.addr,e),Ft(t,e)}}function Vl(s){return s.version===0&&(s.compareFunction=gu,s.needsUpdate=!0),s}function R_(s,e,t){let n=this.cache,i=t.allocateTextureUnit();n[0]!==i&&(s.uniform1i(this.addr,i),n[0]=i);let r;this.type===s.SAMPLER_2D_SHADOW?r=Vl(Qp):r=Jp,t.setTexture2D(e||r,i)}function C_(s,e,t){let n=this.cache,i=t.allocateTextureUnit();n[0]!==i&&(s.uniform1i(this.addr,i),n[0]=i),t.setTexture3D(e||nm,i)}function P_(s,e,t){let n=this.cache,i=t.allocateTextureUnit();n[0]!==i&&(s.uniform1i(this.addr,i),n[0]=i);let r;this.type===s.SAMPLER_CUBE_SHADOW?r=Vl(em):r=im,t.setTextureCube(e||r,i)}function I_(s,e,t){let n=this.cache,i=t.allocateTextureUnit();n[0]!==i&&(s.uniform1i(this.addr,i),n[0]=i),t.setTexture2DArray(e||tm,i)}function L_(s){switch(s){case 5126:return f_;case 35664:return p_;case 35665:return m_;case 35666:return g_;case 35674:return x_;case 35675:return y_;case 35676:return v_;case 5124:case 35670:return __;case 35667:case 35671:return b_;case 35668:case 35672:return M_;case 35669:case 35673:return w_;case 5125:return S_;case 36294:return T_;case 36295:return A_;case 36296:return E_;case 35678:case 36198:case 36298:case 36306:case 35682:return R_;case 35679:case 36299:case 36307:return C_;case 35680:case 36300:case 36308:case 36293:return P_;case 36289:case 36303:case 36311:case 36292:return I_}}function D_(s,e){s.uniform1fv(this.addr,e)}function N_(s,e){let t=Er(e,this.size,2);s.uniform2fv(this.addr,t)}function O_(s,e){let t=Er(e,this.size,3);s.uniform3fv(this.addr,t)}function U_(s,e){let t=Er(e,this.size,4);s.uniform4fv(this.addr,t)}function F_(s,e){let t=Er(e,this.size,4);s.uniformMatrix2fv(this.addr,!1,t)}function k_(s,e){let t=Er(e,this.size,9);s.uniformMatrix3fv(this.addr,!1,t)}function B_(s,e){let t=Er(e,this.size,16);s.uniformMatrix4fv(this.addr,!1,t)}function z_(s,e){s.uniform1iv(this.addr,e)}function H_(s,e){s.uniform2iv(this.addr,e)}function G_(s,e){s.uniform3iv(this.addr,e)}function V_(s,e){s.uniform4iv(this.addr,e)}function W_(s,e){s.uniform1uiv(this.addr,e)}function X_(s,e){s.uniform2uiv(this.addr,e)}function q_(s,e){s.uniform3uiv(this.addr,e)}function $_(s,e){s.uniform4uiv(this.addr,e)}function Y_(s,e,t){let n=this.cache,i=e.length,r=Gl(t,i);Ut(n,r)||(s.uniform1iv(this.addr,r),Ft(n,r));let o;this.type===s.SAMPLER_2D_SHADOW?o=Vl(Qp):o=Jp;for(let a=0;a!==i;++a)t.setTexture2D(e[a]||o,r[a])}function K_(s,e,t){let n=this.cache,i=e.length,r=Gl(t,i);Ut(n,r)||(s.uniform1iv(this.addr,r),Ft(n,r));for(let o=0;o!==i;++o)t.setTexture3D(e[o]||nm,r[o])}function j_(s,e,t){let n=this.cache,i=e.length,r=Gl(t,i);Ut(n,r)||(s.uniform1iv(this.addr,r),Ft(n,r));let o;this.type===s.SAMPLER_CUBE_SHADOW?o=Vl(em):o=im;for(let a=0;a!==i;++a)t.setTextureCube(e[a]||o,r[a])}function Z_(s,e,t){let n=this.cache,i=e.length,r=Gl(t,i);Ut(n,r)||(s.uniform1iv(this.addr,r),Ft(n,r));for(let o=0;o!==i;++o)t.setTexture2DArray(e[o]||tm,r[o])}function J_(s){switch(s){case 5126:return D_;case 35664:return N_;case 35665:return O_;case 35666:return U_;case 35674:return F_;case 35675:return k_;case 35676:return B_;case 5124:case 35670:return z_;case 35667:case 35671:return H_;case 35668:case 35672:return G_;case 35669:case 35673:return V_;case 5125:return W_;case 36294:return X_;case 36295:return q_;case 36296:return $_;case 35678:case 36198:case 36298:case 36306:case 35682:return Y_;case 35679:case 36299:case 36307:return K_;case 35680:case 36300:case 36308:case 36293:return j_;case 36289:case 36303:case 36311:case 36292:return Z_}}var Cu=class{constructor(e,t,n){this.id=e,this.addr=n,this.cache=[],this.type=t.type,this.setValue=L_(t.type)}},Pu=class{constructor(e,t,n){this.id=e,this.addr=n,this.cache=[],this.type=t.type,this.size=t.size,this.setValue=J_(t.type)}},Iu=class{constructor(e){this.id=e,this.seq=[],this.map={}}setValue(e,t,n){let i=this.seq;for(let r=0,o=i.length;r!==o;++r){let a=i[r];a.setValue(e,t[a.id],n)}}},Eu=/(\w+)(\])?(\[|\.)?/g;function Up(s,e){s.seq.push(e),s.map[e.id]=e}function Q_(s,e,t){let n=s.name,i=n.length;for(Eu.lastIndex=0;;){let r=Eu.exec(n),o=Eu.lastIndex,a=r[1],l=r[2]==="]",c=r[3];if(l&&(a=a|0),c===void 0||c==="["&&o+2===i){Up(t,c===void 0?new Cu(a,s,e):new Pu(a,s,e));break}else{let u=t.map[a];u===void 0&&(u=new Iu(a),Up(t,u)),t=u}}}var Sr=class{constructor(e,t){this.seq=[],this.map={};let n=e.getProgramParameter(t,e.ACTIVE_UNIFORMS);for(let o=0;o<n;++o){let a=e.getActiveUniform(t,o),l=e.getUniformLocation(t,a.name);Q_(a,l,this)}let i=[],r=[];for(let o of this.seq)o.type===e.SAMPLER_2D_SHADOW||o.type===e.SAMPLER_CUBE_SHADOW||o.type===e.SAMPLER_2D_ARRAY_SHADOW?i.push(o):r.push(o);i.length>0&&(this.seq=i.concat(r))}setValue(e,t,n,i){let r=this.map[t];r!==void 0&&r.setValue(e,n,i)}setOptional(e,t,n){let i=t[n];i!==void 0&&this.setValue(e,n,i)}static upload(e,t,n,i){for(let r=0,o=t.length;r!==o;++r){let a=t[r],l=n[a.id];l.needsUpdate!==!1&&a.setValue(e,l.value,i)}}static seqWithValue(e,t){let n=[];for(let i=0,r=e.length;i!==r;++i){let o=e[i];o.id in t&&n.push(o)}return n}};function Fp(s,e,t){let n=s.createShader(e);return s.shaderSource(n,t),s.compileShader(n),n}var eb=37297,tb=0;function nb(s,e){let t=s.split(`
`),n=[],i=Math.max(e-6,0),r=Math.min(e+6,t.length);for(let o=i;o<r;o++){let a=o+1;n.push(`${a===e?">":" "} ${a}: ${t[o]}`)}return n.join(`
`)}var kp=new Fe;function ib(s){Xe._getMatrix(kp,Xe.workingColorSpace,s);let e=`mat3( ${kp.elements.map(t=>t.toFixed(4))} )`;switch(Xe.getTransfer(s)){case jr:return[e,"LinearTransferOETF"];case nt:return[e,"sRGBTransferOETF"];default:return Ee("WebGLProgram: Unsupported color space: ",s),[e,"LinearTransferOETF"]}}function Bp(s,e,t){let n=s.getShaderParameter(e,s.COMPILE_STATUS),r=(s.getShaderInfoLog(e)||"").trim();if(n&&r==="")return"";let o=/ERROR: 0:(\d+)/.exec(r);if(o){let a=parseInt(o[1]);return t.toUpperCase()+`

`+r+`

`+nb(s.getShaderSource(e),a)}else return r}function sb(s,e){let t=ib(e);return[`vec4 ${s}( vec4 value ) {`,`	return ${t[1]}( vec4( ${t[0]} * value.rgb, value.a ) );`,"}"].join(`
`)}var rb={[eu]:"Linear",[tu]:"Reinhard",[nu]:"Cineon",[iu]:"ACESFilmic",[ru]:"AgX",[bo]:"Neutral",[su]:"Custom"};function ob(s,e){let t=rb[e];return t===void 0?(Ee("WebGLProgram: Unsupported toneMapping:",e),"vec3 "+s+"( vec3 color ) { return LinearToneMapping( color ); }"):"vec3 "+s+"( vec3 color ) { return "+t+"ToneMapping( color ); }"}var Hl=new S;function ab(){Xe.getLuminanceCoefficients(Hl);let s=Hl.x.toFixed(4),e=Hl.y.toFixed(4),t=Hl.z.toFixed(4);return["float luminance( const in vec3 rgb ) {",`	const vec3 weights = vec3( ${s}, ${e}, ${t} );`,"	return dot( weights, rgb );","}"].join(`
`)}function lb(s){return[s.extensionClipCullDistance?"#extension GL_ANGLE_clip_cull_distance : require":"",s.extensionMultiDraw?"#extension GL_ANGLE_multi_draw : require":""].filter(Io).join(`
`)}function cb(s){let e=[];for(let t in s){let n=s[t];n!==!1&&e.push("#define "+t+" "+n)}return e.join(`
`)}function hb(s,e){let t={},n=s.getProgramParameter(e,s.ACTIVE_ATTRIBUTES);for(let i=0;i<n;i++){let r=s.getActiveAttrib(e,i),o=r.name,a=1;r.type===s.FLOAT_MAT2&&(a=2),r.type===s.FLOAT_MAT3&&(a=3),r.type===s.FLOAT_MAT4&&(a=4),t[o]={type:r.type,location:s.getAttribLocation(e,o),locationSize:a}}return t}function Io(s){return s!==""}function zp(s,e){let t=e.numSpotLightShadows+e.numSpotLightMaps-e.numSpotLightShadowsWithMaps;return s.replace(/NUM_SUN_LIGHTS/g,e.numSunLights).replace(/NUM_DIR_LIGHTS/g,e.numDirLights).replace(/NUM_SPOT_LIGHTS/g,e.numSpotLights).replace(/NUM_SPOT_LIGHT_MAPS/g,e.numSpotLightMaps).replace(/NUM_SPOT_LIGHT_COORDS/g,t).replace(/NUM_RECT_AREA_LIGHTS/g,e.numRectAreaLights).replace(/NUM_POINT_LIGHTS/g,e.numPointLights).replace(/NUM_HEMI_LIGHTS/g,e.numHemiLights).replace(/NUM_SUN_LIGHT_SHADOWS/g,e.numSunLightShadows).replace(/NUM_DIR_LIGHT_SHADOWS/g,e.numDirLightShadows).replace(/NUM_SPOT_LIGHT_SHADOWS_WITH_MAPS/g,e.numSpotLightShadowsWithMaps).replace(/NUM_SPOT_LIGHT_SHADOWS/g,e.numSpotLightShadows).replace(/NUM_POINT_LIGHT_SHADOWS/g,e.numPointLightShadows).replace(/NUM_LIGHT_PROBE_GRIDS/g,e.numLightProbeGrids)}function Hp(s,e){return s.replace(/NUM_CLIPPING_PLANES/g,e.numClippingPlanes).replace(/UNION_CLIPPING_PLANES/g,e.numClippingPlanes-e.numClipIntersection)}var ub=/^[ \t]*#include +<([\w\d./]+)>/gm;function Lu(s){return s.replace(ub,db)}function db(s,e){let t=We[e];if(t===void 0)throw new Error("THREE.WebGLProgram: Can not resolve #include <"+e+">");return Lu(t)}var fb=/#pragma unroll_loop_start\s+for\s*\(\s*int\s+i\s*=\s*(\d+)\s*;\s*i\s*<\s*(\d+)\s*;\s*i\s*\+\+\s*\)\s*{([\s\S]+?)}\s+#pragma unroll_loop_end/g;function Gp(s){return s.replace(fb,pb)}function pb(s,e,t,n){let i="";for(let r=parseInt(e);r<parseInt(t);r++)i+=n.replace(/\[\s*i\s*\]/g,"[ "+r+" ]").replace(/UNROLLED_LOOP_INDEX/g,r);return i}function Vp(s){let e=`precision ${s.precision} float;
	precision ${s.precision} int;
	precision ${s.precision} sampler2D;
	precision ${s.precision} samplerCube;
	precision ${s.precision} sampler3D;
	precision ${s.precision} sampler2DArray;
	precision ${s.precision} sampler2DShadow;
	precision ${s.precision} samplerCubeShadow;
	precision ${s.precision} sampler2DArrayShadow;
	precision ${s.precision} isampler2D;
	precision ${s.precision} isampler3D;
	precision ${s.precision} isamplerCube;
	precision ${s.precision} isampler2DArray;
	precision ${s.precision} usampler2D;
	precision ${s.precision} usampler3D;
	precision ${s.precision} usamplerCube;
	precision ${s.precision} usampler2DArray;
	`;return s.precision==="highp"?e+=`
#define HIGH_PRECISION`:s.precision==="mediump"?e+=`
#define MEDIUM_PRECISION`:s.precision==="lowp"&&(e+=`
#define LOW_PRECISION`),e}var mb={[bs]:"SHADOWMAP_TYPE_PCF",[yr]:"SHADOWMAP_TYPE_VSM"};function gb(s){return mb[s.shadowMapType]||"SHADOWMAP_TYPE_BASIC"}var xb={[_r]:"ENVMAP_MODE_REFRACTION"};function yb(s){return s.envMap===!1?"ENVMAP_MODE_REFLECTION":xb[s.envMapMode]||"ENVMAP_MODE_REFLECTION"}var vb={[Ja]:"ENVMAP_BLENDING_MULTIPLY",[op]:"ENVMAP_BLENDING_MIX",[ap]:"ENVMAP_BLENDING_ADD"};function _b(s){return s.envMap===!1?"ENVMAP_BLENDING_NONE":vb[s.combine]||"ENVMAP_BLENDING_NONE"}function bb(s,e,t,n){let i=s.getContext(),r=t.defines,o=t.vertexShader,a=t.fragmentShader,l=gb(t),c=t.envMapPMREM===!0?"ENVMAP_TYPE_PMREM":"ENVMAP_TYPE_CUBE",h=yb(t),u=_b(t),d=lb(t),f=cb(r),g=i.createProgram(),y,p,m=t.glslVersion?"#version "+t.glslVersion+`
`:"";t.isRawShaderMaterial?(y=["#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,f].filter(Io).join(`
`),y.length>0&&(y+=`
`),p=["#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,f].filter(Io).join(`
`),p.length>0&&(p+=`
`)):(y=[Vp(t),"#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,f,t.extensionClipCullDistance?"#define USE_CLIP_DISTANCE":"",t.batching?"#define USE_BATCHING":"",t.batchingColor?"#define USE_BATCHING_COLOR":"",t.instancing?"#define USE_INSTANCING":"",t.instancingColor?"#define USE_INSTANCING_COLOR":"",t.instancingMorph?"#define USE_INSTANCING_MORPH":"",t.useFog&&t.fog?"#define USE_FOG":"",t.useFog&&t.fogExp2?"#define FOG_EXP2":"",t.map?"#define USE_MAP":"",t.envMap?"#define USE_ENVMAP":"",t.envMap?"#define "+h:"",t.lightMap?"#define USE_LIGHTMAP":"",t.aoMap?"#define USE_AOMAP":"",t.bumpMap?"#define USE_BUMPMAP":"",t.normalMap?"#define USE_NORMALMAP":"",t.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",t.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",t.displacementMap?"#define USE_DISPLACEMENTMAP":"",t.emissiveMap?"#define USE_EMISSIVEMAP":"",t.anisotropy?"#define USE_ANISOTROPY":"",t.anisotropyMap?"#define USE_ANISOTROPYMAP":"",t.clearcoatMap?"#define USE_CLEARCOATMAP":"",t.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",t.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",t.diffuseRoughnessMap?"#define USE_DIFFUSE_ROUGHNESSMAP":"",t.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",t.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",t.specularMap?"#define USE_SPECULARMAP":"",t.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",t.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",t.roughnessMap?"#define USE_ROUGHNESSMAP":"",t.metalnessMap?"#define USE_METALNESSMAP":"",t.alphaMap?"#define USE_ALPHAMAP":"",t.alphaHash?"#define USE_ALPHAHASH":"",t.transmission?"#define USE_TRANSMISSION":"",t.transmissionMap?"#define USE_TRANSMISSIONMAP":"",t.thicknessMap?"#define USE_THICKNESSMAP":"",t.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",t.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",t.mapUv?"#define MAP_UV "+t.mapUv:"",t.alphaMapUv?"#define ALPHAMAP_UV "+t.alphaMapUv:"",t.lightMapUv?"#define LIGHTMAP_UV "+t.lightMapUv:"",t.aoMapUv?"#define AOMAP_UV "+t.aoMapUv:"",t.emissiveMapUv?"#define EMISSIVEMAP_UV "+t.emissiveMapUv:"",t.bumpMapUv?"#define BUMPMAP_UV "+t.bumpMapUv:"",t.normalMapUv?"#define NORMALMAP_UV "+t.normalMapUv:"",t.displacementMapUv?"#define DISPLACEMENTMAP_UV "+t.displacementMapUv:"",t.metalnessMapUv?"#define METALNESSMAP_UV "+t.metalnessMapUv:"",t.roughnessMapUv?"#define ROUGHNESSMAP_UV "+t.roughnessMapUv:"",t.anisotropyMapUv?"#define ANISOTROPYMAP_UV "+t.anisotropyMapUv:"",t.clearcoatMapUv?"#define CLEARCOATMAP_UV "+t.clearcoatMapUv:"",t.clearcoatNormalMapUv?"#define CLEARCOAT_NORMALMAP_UV "+t.clearcoatNormalMapUv:"",t.clearcoatRoughnessMapUv?"#define CLEARCOAT_ROUGHNESSMAP_UV "+t.clearcoatRoughnessMapUv:"",t.diffuseRoughnessMapUv?"#define DIFFUSE_ROUGHNESSMAP_UV "+t.diffuseRoughnessMapUv:"",t.iridescenceMapUv?"#define IRIDESCENCEMAP_UV "+t.iridescenceMapUv:"",t.iridescenceThicknessMapUv?"#define IRIDESCENCE_THICKNESSMAP_UV "+t.iridescenceThicknessMapUv:"",t.sheenColorMapUv?"#define SHEEN_COLORMAP_UV "+t.sheenColorMapUv:"",t.sheenRoughnessMapUv?"#define SHEEN_ROUGHNESSMAP_UV "+t.sheenRoughnessMapUv:"",t.specularMapUv?"#define SPECULARMAP_UV "+t.specularMapUv:"",t.specularColorMapUv?"#define SPECULAR_COLORMAP_UV "+t.specularColorMapUv:"",t.specularIntensityMapUv?"#define SPECULAR_INTENSITYMAP_UV "+t.specularIntensityMapUv:"",t.transmissionMapUv?"#define TRANSMISSIONMAP_UV "+t.transmissionMapUv:"",t.thicknessMapUv?"#define THICKNESSMAP_UV "+t.thicknessMapUv:"",t.vertexTangents&&t.flatShading===!1?"#define USE_TANGENT":"",t.vertexNormals?"#define HAS_NORMAL":"",t.vertexColors?"#define USE_COLOR":"",t.vertexAlphas?"#define USE_COLOR_ALPHA":"",t.vertexUv1s?"#define USE_UV1":"",t.vertexUv2s?"#define USE_UV2":"",t.vertexUv3s?"#define USE_UV3":"",t.pointsUvs?"#define USE_POINTS_UV":"",t.flatShading?"#define FLAT_SHADED":"",t.skinning?"#define USE_SKINNING":"",t.morphTargets?"#define USE_MORPHTARGETS":"",t.morphNormals&&t.flatShading===!1?"#define USE_MORPHNORMALS":"",t.morphColors?"#define USE_MORPHCOLORS":"",t.morphTargetsCount>0?"#define MORPHTARGETS_TEXTURE_STRIDE "+t.morphTextureStride:"",t.morphTargetsCount>0?"#define MORPHTARGETS_COUNT "+t.morphTargetsCount:"",t.doubleSided?"#define DOUBLE_SIDED":"",t.flipSided?"#define FLIP_SIDED":"",t.shadowMapEnabled?"#define USE_SHADOWMAP":"",t.shadowMapEnabled?"#define "+l:"",t.sizeAttenuation?"#define USE_SIZEATTENUATION":"",t.numLightProbes>0?"#define USE_LIGHT_PROBES":"",t.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",t.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 modelMatrix;","uniform mat4 modelViewMatrix;","uniform mat4 projectionMatrix;","uniform mat4 viewMatrix;","uniform mat3 normalMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;","#ifdef USE_INSTANCING","	attribute mat4 instanceMatrix;","#endif","#ifdef USE_INSTANCING_COLOR","	attribute vec3 instanceColor;","#endif","#ifdef USE_INSTANCING_MORPH","	uniform sampler2D morphTexture;","#endif","attribute vec3 position;","attribute vec3 normal;","attribute vec2 uv;","#ifdef USE_UV1","	attribute vec2 uv1;","#endif","#ifdef USE_UV2","	attribute vec2 uv2;","#endif","#ifdef USE_UV3","	attribute vec2 uv3;","#endif","#ifdef USE_TANGENT","	attribute vec4 tangent;","#endif","#if defined( USE_COLOR_ALPHA )","	attribute vec4 color;","#elif defined( USE_COLOR )","	attribute vec3 color;","#endif","#ifdef USE_SKINNING","	attribute vec4 skinIndex;","	attribute vec4 skinWeight;","#endif",`
`].filter(Io).join(`
`),p=[Vp(t),"#define SHADER_TYPE "+t.shaderType,"#define SHADER_NAME "+t.shaderName,f,t.useFog&&t.fog?"#define USE_FOG":"",t.useFog&&t.fogExp2?"#define FOG_EXP2":"",t.alphaToCoverage?"#define ALPHA_TO_COVERAGE":"",t.map?"#define USE_MAP":"",t.matcap?"#define USE_MATCAP":"",t.envMap?"#define USE_ENVMAP":"",t.envMap?"#define "+c:"",t.envMap?"#define "+h:"",t.envMap?"#define "+u:"",t.envMapPMREM?"#define ENVMAP_MAX_LOD "+t.envMapMaxLod+".0":"",t.envMapPMREM?"#define ENVMAP_SIZE "+t.envMapSize+".0":"",t.lightMap?"#define USE_LIGHTMAP":"",t.aoMap?"#define USE_AOMAP":"",t.bumpMap?"#define USE_BUMPMAP":"",t.normalMap?"#define USE_NORMALMAP":"",t.normalMapObjectSpace?"#define USE_NORMALMAP_OBJECTSPACE":"",t.normalMapTangentSpace?"#define USE_NORMALMAP_TANGENTSPACE":"",t.packedNormalMap?"#define USE_PACKED_NORMALMAP":"",t.emissiveMap?"#define USE_EMISSIVEMAP":"",t.anisotropy?"#define USE_ANISOTROPY":"",t.anisotropyMap?"#define USE_ANISOTROPYMAP":"",t.clearcoat?"#define USE_CLEARCOAT":"",t.clearcoatMap?"#define USE_CLEARCOATMAP":"",t.clearcoatRoughnessMap?"#define USE_CLEARCOAT_ROUGHNESSMAP":"",t.clearcoatNormalMap?"#define USE_CLEARCOAT_NORMALMAP":"",t.diffuseRoughness?"#define USE_DIFFUSE_ROUGHNESS":"",t.diffuseRoughnessMap?"#define USE_DIFFUSE_ROUGHNESSMAP":"",t.dispersion?"#define USE_DISPERSION":"",t.retroreflection?"#define USE_RETROREFLECTION":"",t.iridescence?"#define USE_IRIDESCENCE":"",t.iridescenceMap?"#define USE_IRIDESCENCEMAP":"",t.iridescenceThicknessMap?"#define USE_IRIDESCENCE_THICKNESSMAP":"",t.specularMap?"#define USE_SPECULARMAP":"",t.specularColorMap?"#define USE_SPECULAR_COLORMAP":"",t.specularIntensityMap?"#define USE_SPECULAR_INTENSITYMAP":"",t.roughnessMap?"#define USE_ROUGHNESSMAP":"",t.metalnessMap?"#define USE_METALNESSMAP":"",t.alphaMap?"#define USE_ALPHAMAP":"",t.alphaTest?"#define USE_ALPHATEST":"",t.alphaHash?"#define USE_ALPHAHASH":"",t.sheen?"#define USE_SHEEN":"",t.sheenColorMap?"#define USE_SHEEN_COLORMAP":"",t.sheenRoughnessMap?"#define USE_SHEEN_ROUGHNESSMAP":"",t.transmission?"#define USE_TRANSMISSION":"",t.transmissionMap?"#define USE_TRANSMISSIONMAP":"",t.thicknessMap?"#define USE_THICKNESSMAP":"",t.vertexTangents&&t.flatShading===!1?"#define USE_TANGENT":"",t.vertexColors||t.instancingColor?"#define USE_COLOR":"",t.vertexAlphas||t.batchingColor?"#define USE_COLOR_ALPHA":"",t.vertexUv1s?"#define USE_UV1":"",t.vertexUv2s?"#define USE_UV2":"",t.vertexUv3s?"#define USE_UV3":"",t.pointsUvs?"#define USE_POINTS_UV":"",t.gradientMap?"#define USE_GRADIENTMAP":"",t.flatShading?"#define FLAT_SHADED":"",t.doubleSided?"#define DOUBLE_SIDED":"",t.flipSided?"#define FLIP_SIDED":"",t.shadowMapEnabled?"#define USE_SHADOWMAP":"",t.shadowMapEnabled?"#define "+l:"",t.premultipliedAlpha?"#define PREMULTIPLIED_ALPHA":"",t.numLightProbes>0?"#define USE_LIGHT_PROBES":"",t.decodeVideoTexture?"#define DECODE_VIDEO_TEXTURE":"",t.decodeVideoTextureEmissive?"#define DECODE_VIDEO_TEXTURE_EMISSIVE":"",t.logarithmicDepthBuffer?"#define USE_LOGARITHMIC_DEPTH_BUFFER":"",t.reversedDepthBuffer?"#define USE_REVERSED_DEPTH_BUFFER":"","uniform mat4 viewMatrix;","uniform vec3 cameraPosition;","uniform bool isOrthographic;",t.toneMapping!==ti?"#define TONE_MAPPING":"",t.toneMapping!==ti?We.tonemapping_pars_fragment:"",t.toneMapping!==ti?ob("toneMapping",t.toneMapping):"",t.dithering?"#define DITHERING":"",t.opaque?"#define OPAQUE":"",We.colorspace_pars_fragment,sb("linearToOutputTexel",t.outputColorSpace),ab(),t.useDepthPacking?"#define DEPTH_PACKING "+t.depthPacking:"",`
`].filter(Io).join(`
`)),o=Lu(o),o=zp(o,t),o=Hp(o,t),a=Lu(a),a=zp(a,t),a=Hp(a,t),o=Gp(o),a=Gp(a),t.isRawShaderMaterial!==!0&&(m=`#version 300 es
`,y=[d,"#define attribute in","#define varying out","#define texture2D texture"].join(`
`)+`
`+y,p=["#define varying in",t.glslVersion===yu?"":"layout(location = 0) out highp vec4 pc_fragColor;",t.glslVersion===yu?"":"#define gl_FragColor pc_fragColor","#define gl_FragDepthEXT gl_FragDepth","#define texture2D texture","#define textureCube texture","#define texture2DProj textureProj","#define texture2DLodEXT textureLod","#define texture2DProjLodEXT textureProjLod","#define textureCubeLodEXT textureLod","#define texture2DGradEXT textureGrad","#define texture2DProjGradEXT textureProjGrad","#define textureCubeGradEXT textureGrad"].join(`
`)+`
`+p);let b=m+y+o,E=m+p+a,M=Fp(i,i.VERTEX_SHADER,b),R=Fp(i,i.FRAGMENT_SHADER,E);i.attachShader(g,M),i.attachShader(g,R),t.index0AttributeName!==void 0?i.bindAttribLocation(g,0,t.index0AttributeName):t.hasPositionAttribute===!0&&i.bindAttribLocation(g,0,"position"),i.linkProgram(g);function T(I){if(s.debug.checkShaderErrors){let N=i.getProgramInfoLog(g)||"",k=i.getShaderInfoLog(M)||"",V=i.getShaderInfoLog(R)||"",P=N.trim(),G=k.trim(),q=V.trim(),H=!0,te=!0;if(i.getProgramParameter(g,i.LINK_STATUS)===!1)if(H=!1,typeof s.debug.onShaderError=="function")s.debug.onShaderError(i,g,M,R);else{let X=Bp(i,M,"vertex"),J=Bp(i,R,"fragment");Oe("WebGLProgram: Shader Error "+i.getError()+" - VALIDATE_STATUS "+i.getProgramParameter(g,i.VALIDATE_STATUS)+`

Material Name: `+I.name+`
Material Type: `+I.type+`

Program Info Log: `+P+`
`+X+`
`+J)}else P!==""?Ee("WebGLProgram: Program Info Log:",P):(G===""||q==="")&&(te=!1);te&&(I.diagnostics={runnable:H,programLog:P,vertexShader:{log:G,prefix:y},fragmentShader:{log:q,prefix:p}})}i.deleteShader(M),i.deleteShader(R),x=new Sr(i,g),w=hb(i,g)}let x;this.getUniforms=function(){return x===void 0&&T(this),x};let w;this.getAttributes=function(){return w===void 0&&T(this),w};let O=t.rendererExtensionParallelShaderCompile===!1;return this.isReady=function(){return O===!1&&(O=i.getProgramParameter(g,eb)),O},this.destroy=function(){n.releaseStatesOfProgram(this),i.deleteProgram(g),this.program=void 0},this.type=t.shaderType,this.name=t.shaderName,this.id=tb++,this.cacheKey=e,this.usedTimes=1,this.program=g,this.vertexShader=M,this.fragmentShader=R,this}var Mb=0,Du=class{constructor(){this.shaderCache=new Map,this.materialCache=new Map}update(e,t,n){let i=this._getShaderCacheForMaterial(e);return i.has(t)===!1&&(i.add(t),t.usedTimes++),i.has(n)===!1&&(i.add(n),n.usedTimes++),this}remove(e){let t=this.materialCache.get(e);for(let n of t)n.usedTimes--,n.usedTimes===0&&this.shaderCache.delete(n.code);return this.materialCache.delete(e),this}getVertexShaderStage(e){return this._getShaderStage(e.vertexShader)}getFragmentShaderStage(e){return this._getShaderStage(e.fragmentShader)}dispose(){this.shaderCache.clear(),this.materialCache.clear()}_getShaderCacheForMaterial(e){let t=this.materialCache,n=t.get(e);return n===void 0&&(n=new Set,t.set(e,n)),n}_getShaderStage(e){let t=this.shaderCache,n=t.get(e);return n===void 0&&(n=new Nu(e),t.set(e,n)),n}},Nu=class{constructor(e){this.id=Mb++,this.code=e,this.usedTimes=0}};function wb(s){return s===Ji||s===Ao||s===Eo}function Sb(s,e,t,n,i,r){let o=new lr,a=new Du,l=new Set,c=[],h=new Map,u=n.logarithmicDepthBuffer,d={MeshDepthMaterial:"depth",MeshDistanceMaterial:"distance",MeshNormalMaterial:"normal",MeshBasicMaterial:"basic",MeshLambertMaterial:"lambert",MeshPhongMaterial:"phong",MeshToonMaterial:"toon",MeshStandardMaterial:"physical",MeshPhysicalMaterial:"physical",MeshMatcapMaterial:"matcap",LineBasicMaterial:"basic",LineDashedMaterial:"dashed",PointsMaterial:"points",ShadowMaterial:"shadow",SpriteMaterial:"sprite"};function f(x){return l.add(x),x===0?"uv":`uv${x}`}function g(x,w,O,I,N,k){let V=I.fog,P=N.geometry,G=x.isMeshStandardMaterial||x.isMeshLambertMaterial||x.isMeshPhongMaterial?I.environment:null,q=x.isMeshStandardMaterial||x.isMeshLambertMaterial&&!x.envMap||x.isMeshPhongMaterial&&!x.envMap,H=e.get(x.envMap||G,q),te=d[x.type],X=n.precision;x.precision!==null&&(X=n.getMaxPrecision(x.precision),X!==x.precision&&Ee("WebGLProgram.getParameters:",x.precision,"not supported, using",X,"instead."));let J=P.morphAttributes.position||P.morphAttributes.normal||P.morphAttributes.color,Q=J!==void 0?J.length:0,Te=0;P.morphAttributes.position!==void 0&&(Te=1),P.morphAttributes.normal!==void 0&&(Te=2),P.morphAttributes.color!==void 0&&(Te=3);let Be,K,me,Me;if(te){let fe=si[te];Be=fe.vertexShader,K=fe.fragmentShader}else{Be=x.vertexShader,K=x.fragmentShader;let fe=a.getVertexShaderStage(x),rt=a.getFragmentShaderStage(x);a.update(x,fe,rt),me=fe.id,Me=rt.id}let Ie=s.getRenderTarget(),ge=s.state.buffers.depth.getReversed(),He=N.isInstancedMesh===!0,Rt=N.isBatchedMesh===!0,Ne=!!x.map,st=!!x.matcap,ct=!!H,Ke=ct&&H.isPMREMTexture===!0,Xt=!!x.aoMap,Lt=!!x.lightMap,hn=!!x.bumpMap&&x.wireframe===!1,xt=!!x.normalMap,qn=!!x.displacementMap,Bt=!!x.emissiveMap,Sn=!!x.metalnessMap,Tn=!!x.roughnessMap,An=x.anisotropy>0,D=x.clearcoat>0,En=x.diffuseRoughness>0,pt=x.dispersion>0,mt=x.retroreflectivity>0,de=x.iridescence>0,Dt=x.sheen>0,Le=x.transmission>0,ke=An&&!!x.anisotropyMap,A=D&&!!x.clearcoatMap,v=D&&!!x.clearcoatNormalMap,F=D&&!!x.clearcoatRoughnessMap,ee=En&&!!x.diffuseRoughnessMap,Z=de&&!!x.iridescenceMap,se=de&&!!x.iridescenceThicknessMap,ce=Dt&&!!x.sheenColorMap,$=Dt&&!!x.sheenRoughnessMap,Y=!!x.specularMap,oe=!!x.specularColorMap,C=!!x.specularIntensityMap,j=Le&&!!x.transmissionMap,W=Le&&!!x.thicknessMap,ae=!!x.gradientMap,ie=!!x.alphaMap,re=x.alphaTest>0,Re=!!x.alphaHash,Ve=!!x.extensions,ne=ti;x.toneMapped&&(Ie===null||Ie.isXRRenderTarget===!0)&&(ne=s.toneMapping);let Ce=Ke?H.isCompressedCubeTexture?H.image[0].mipmaps:H.mipmaps:null,Ge={shaderID:te,shaderType:x.type,shaderName:x.name,vertexShader:Be,fragmentShader:K,defines:x.defines,customVertexShaderID:me,customFragmentShaderID:Me,isRawShaderMaterial:x.isRawShaderMaterial===!0,glslVersion:x.glslVersion,precision:X,batching:Rt,batchingColor:Rt&&N._colorsTexture!==null,instancing:He,instancingColor:He&&N.instanceColor!==null,instancingMorph:He&&N.morphTexture!==null,outputColorSpace:Ie===null?s.outputColorSpace:Ie.isXRRenderTarget===!0?Ie.texture.colorSpace:Xe.workingColorSpace,alphaToCoverage:!!x.alphaToCoverage,map:Ne,matcap:st,envMap:ct,envMapMode:ct&&H.mapping,envMapPMREM:Ke,envMapMaxLod:Ke?Ce.length-1:null,envMapSize:Ke?Ce[0].width:null,aoMap:Xt,lightMap:Lt,bumpMap:hn,normalMap:xt,displacementMap:qn,emissiveMap:Bt,normalMapObjectSpace:xt&&x.normalMapType===up,normalMapTangentSpace:xt&&x.normalMapType===Co,packedNormalMap:xt&&x.normalMapType===Co&&wb(x.normalMap.format),metalnessMap:Sn,roughnessMap:Tn,anisotropy:An,anisotropyMap:ke,clearcoat:D,clearcoatMap:A,clearcoatNormalMap:v,clearcoatRoughnessMap:F,diffuseRoughness:En,diffuseRoughnessMap:ee,dispersion:pt,retroreflection:mt,iridescence:de,iridescenceMap:Z,iridescenceThicknessMap:se,sheen:Dt,sheenColorMap:ce,sheenRoughnessMap:$,specularMap:Y,specularColorMap:oe,specularIntensityMap:C,transmission:Le,transmissionMap:j,thicknessMap:W,gradientMap:ae,opaque:x.transparent===!1&&x.blending===vr&&x.alphaToCoverage===!1,alphaMap:ie,alphaTest:re,alphaHash:Re,combine:x.combine,mapUv:Ne&&f(x.map.channel),aoMapUv:Xt&&f(x.aoMap.channel),lightMapUv:Lt&&f(x.lightMap.channel),bumpMapUv:hn&&f(x.bumpMap.channel),normalMapUv:xt&&f(x.normalMap.channel),displacementMapUv:qn&&f(x.displacementMap.channel),emissiveMapUv:Bt&&f(x.emissiveMap.channel),metalnessMapUv:Sn&&f(x.metalnessMap.channel),roughnessMapUv:Tn&&f(x.roughnessMap.channel),anisotropyMapUv:ke&&f(x.anisotropyMap.channel),clearcoatMapUv:A&&f(x.clearcoatMap.channel),clearcoatNormalMapUv:v&&f(x.clearcoatNormalMap.channel),clearcoatRoughnessMapUv:F&&f(x.clearcoatRoughnessMap.channel),diffuseRoughnessMapUv:ee&&f(x.diffuseRoughnessMap.channel),iridescenceMapUv:Z&&f(x.iridescenceMap.channel),iridescenceThicknessMapUv:se&&f(x.iridescenceThicknessMap.channel),sheenColorMapUv:ce&&f(x.sheenColorMap.channel),sheenRoughnessMapUv:$&&f(x.sheenRoughnessMap.channel),specularMapUv:Y&&f(x.specularMap.channel),specularColorMapUv:oe&&f(x.specularColorMap.channel),specularIntensityMapUv:C&&f(x.specularIntensityMap.channel),transmissionMapUv:j&&f(x.transmissionMap.channel),thicknessMapUv:W&&f(x.thicknessMap.channel),alphaMapUv:ie&&f(x.alphaMap.channel),vertexTangents:!!P.attributes.tangent&&(xt||An),vertexNormals:!!P.attributes.normal,vertexColors:x.vertexColors,vertexAlphas:x.vertexColors===!0&&!!P.attributes.color&&P.attributes.color.itemSize===4,pointsUvs:N.isPoints===!0&&!!P.attributes.uv&&(Ne||ie),fog:!!V,useFog:x.fog===!0,fogExp2:!!V&&V.isFogExp2,flatShading:x.wireframe===!1&&(x.flatShading===!0||P.attributes.normal===void 0&&xt===!1&&(x.isMeshLambertMaterial||x.isMeshPhongMaterial||x.isMeshStandardMaterial||x.isMeshPhysicalMaterial)),sizeAttenuation:x.sizeAttenuation===!0,logarithmicDepthBuffer:u,reversedDepthBuffer:ge,skinning:N.isSkinnedMesh===!0,hasPositionAttribute:P.attributes.position!==void 0,morphTargets:P.morphAttributes.position!==void 0,morphNormals:P.morphAttributes.normal!==void 0,morphColors:P.morphAttributes.color!==void 0,morphTargetsCount:Q,morphTextureStride:Te,numSunLights:w.sun.length,numDirLights:w.directional.length,numPointLights:w.point.length,numSpotLights:w.spot.length,numSpotLightMaps:w.spotLightMap.length,numRectAreaLights:w.rectArea.length,numHemiLights:w.hemi.length,numSunLightShadows:w.sunShadowMap.length,numDirLightShadows:w.directionalShadowMap.length,numPointLightShadows:w.pointShadowMap.length,numSpotLightShadows:w.spotShadowMap.length,numSpotLightShadowsWithMaps:w.numSpotLightShadowsWithMaps,numLightProbes:w.numLightProbes,numLightProbeGrids:k.filter(fe=>fe.texture!==null).length,numClippingPlanes:r.numPlanes,numClipIntersection:r.numIntersection,dithering:x.dithering,shadowMapEnabled:s.shadowMap.enabled&&O.length>0,shadowMapType:s.shadowMap.type,toneMapping:ne,decodeVideoTexture:Ne&&x.map.isVideoTexture===!0&&Xe.getTransfer(x.map.colorSpace)===nt,decodeVideoTextureEmissive:Bt&&x.emissiveMap.isVideoTexture===!0&&Xe.getTransfer(x.emissiveMap.colorSpace)===nt,premultipliedAlpha:x.premultipliedAlpha,doubleSided:x.side===It,flipSided:x.side===Kt,useDepthPacking:x.depthPacking>=0,depthPacking:x.depthPacking||0,index0AttributeName:x.index0AttributeName,extensionClipCullDistance:Ve&&x.extensions.clipCullDistance===!0&&t.has("WEBGL_clip_cull_distance"),extensionMultiDraw:(Ve&&x.extensions.multiDraw===!0||Rt)&&t.has("WEBGL_multi_draw"),rendererExtensionParallelShaderCompile:t.has("KHR_parallel_shader_compile"),customProgramCacheKey:x.customProgramCacheKey()};return Ge.vertexUv1s=l.has(1),Ge.vertexUv2s=l.has(2),Ge.vertexUv3s=l.has(3),l.clear(),Ge}function y(x){let w=[];if(x.shaderID?w.push(x.shaderID):(w.push(x.customVertexShaderID),w.push(x.customFragmentShaderID)),x.defines!==void 0)for(let O in x.defines)w.push(O),w.push(x.defines[O]);return x.isRawShaderMaterial===!1&&(p(w,x),m(w,x),w.push(s.outputColorSpace)),w.push(x.customProgramCacheKey),w.join()}function p(x,w){x.push(w.precision),x.push(w.outputColorSpace),x.push(w.envMapMode),x.push(w.envMapPMREM),x.push(w.envMapMaxLod),x.push(w.envMapSize),x.push(w.mapUv),x.push(w.alphaMapUv),x.push(w.lightMapUv),x.push(w.aoMapUv),x.push(w.bumpMapUv),x.push(w.normalMapUv),x.push(w.displacementMapUv),x.push(w.emissiveMapUv),x.push(w.metalnessMapUv),x.push(w.roughnessMapUv),x.push(w.anisotropyMapUv),x.push(w.clearcoatMapUv),x.push(w.clearcoatNormalMapUv),x.push(w.clearcoatRoughnessMapUv),x.push(w.diffuseRoughnessMapUv),x.push(w.iridescenceMapUv),x.push(w.iridescenceThicknessMapUv),x.push(w.sheenColorMapUv),x.push(w.sheenRoughnessMapUv),x.push(w.specularMapUv),x.push(w.specularColorMapUv),x.push(w.specularIntensityMapUv),x.push(w.transmissionMapUv),x.push(w.thicknessMapUv),x.push(w.combine),x.push(w.fogExp2),x.push(w.sizeAttenuation),x.push(w.morphTargetsCount),x.push(w.numSunLights),x.push(w.numDirLights),x.push(w.numPointLights),x.push(w.numSpotLights),x.push(w.numSpotLightMaps),x.push(w.numHemiLights),x.push(w.numRectAreaLights),x.push(w.numSunLightShadows),x.push(w.numDirLightShadows),x.push(w.numPointLightShadows),x.push(w.numSpotLightShadows),x.push(w.numSpotLightShadowsWithMaps),x.push(w.numLightProbes),x.push(w.numLightProbeGrids),x.push(w.shadowMapType),x.push(w.toneMapping),x.push(w.numClippingPlanes),x.push(w.numClipIntersection),x.push(w.depthPacking)}function m(x,w){o.disableAll(),w.instancing&&o.enable(0),w.instancingColor&&o.enable(1),w.instancingMorph&&o.enable(2),w.matcap&&o.enable(3),w.envMap&&o.enable(4),w.normalMapObjectSpace&&o.enable(5),w.normalMapTangentSpace&&o.enable(6),w.clearcoat&&o.enable(7),w.iridescence&&o.enable(8),w.alphaTest&&o.enable(9),w.vertexColors&&o.enable(10),w.vertexAlphas&&o.enable(11),w.vertexUv1s&&o.enable(12),w.vertexUv2s&&o.enable(13),w.vertexUv3s&&o.enable(14),w.vertexTangents&&o.enable(15),w.anisotropy&&o.enable(16),w.alphaHash&&o.enable(17),w.batching&&o.enable(18),w.dispersion&&o.enable(19),w.retroreflection&&o.enable(24),w.diffuseRoughness&&o.enable(25),w.batchingColor&&o.enable(20),w.gradientMap&&o.enable(21),w.packedNormalMap&&o.enable(22),w.vertexNormals&&o.enable(23),x.push(o.mask),o.disableAll(),w.fog&&o.enable(0),w.useFog&&o.enable(1),w.flatShading&&o.enable(2),w.logarithmicDepthBuffer&&o.enable(3),w.reversedDepthBuffer&&o.enable(4),w.skinning&&o.enable(5),w.morphTargets&&o.enable(6),w.morphNormals&&o.enable(7),w.morphColors&&o.enable(8),w.premultipliedAlpha&&o.enable(9),w.shadowMapEnabled&&o.enable(10),w.doubleSided&&o.enable(11),w.flipSided&&o.enable(12),w.useDepthPacking&&o.enable(13),w.dithering&&o.enable(14),w.transmission&&o.enable(15),w.sheen&&o.enable(16),w.opaque&&o.enable(17),w.pointsUvs&&o.enable(18),w.decodeVideoTexture&&o.enable(19),w.decodeVideoTextureEmissive&&o.enable(20),w.alphaToCoverage&&o.enable(21),w.numLightProbeGrids>0&&o.enable(22),w.hasPositionAttribute&&o.enable(23),x.push(o.mask)}function b(x){let w=d[x.type],O;if(w){let I=si[w];O=Sp.clone(I.uniforms)}else O=x.uniforms;return O}function E(x,w){let O=h.get(w);return O!==void 0?++O.usedTimes:(O=new bb(s,w,x,i),c.push(O),h.set(w,O)),O}function M(x){if(--x.usedTimes===0){let w=c.indexOf(x);c[w]=c[c.length-1],c.pop(),h.delete(x.cacheKey),x.destroy()}}function R(x){a.remove(x)}function T(){a.dispose()}return{getParameters:g,getProgramCacheKey:y,getUniforms:b,acquireProgram:E,releaseProgram:M,releaseShaderCache:R,programs:c,dispose:T}}function Tb(){let s=new WeakMap;function e(o){return s.has(o)}function t(o){let a=s.get(o);return a===void 0&&(a={},s.set(o,a)),a}function n(o){s.delete(o)}function i(o,a,l){s.get(o)[a]=l}function r(){s=new WeakMap}return{has:e,get:t,remove:n,update:i,dispose:r}}function Ab(s,e){return s.groupOrder!==e.groupOrder?s.groupOrder-e.groupOrder:s.renderOrder!==e.renderOrder?s.renderOrder-e.renderOrder:s.material.id!==e.material.id?s.material.id-e.material.id:s.materialVariant!==e.materialVariant?s.materialVariant-e.materialVariant:s.z!==e.z?s.z-e.z:s.id-e.id}function Wp(s,e){return s.groupOrder!==e.groupOrder?s.groupOrder-e.groupOrder:s.renderOrder!==e.renderOrder?s.renderOrder-e.renderOrder:s.z!==e.z?e.z-s.z:s.id-e.id}function Xp(){let s=[],e=0,t=[],n=[],i=[];function r(){e=0,t.length=0,n.length=0,i.length=0}function o(d){let f=0;return d.isInstancedMesh&&(f+=2),d.isSkinnedMesh&&(f+=1),f}function a(d,f,g,y,p,m){let b=s[e];return b===void 0?(b={id:d.id,object:d,geometry:f,material:g,materialVariant:o(d),groupOrder:y,renderOrder:d.renderOrder,z:p,group:m},s[e]=b):(b.id=d.id,b.object=d,b.geometry=f,b.material=g,b.materialVariant=o(d),b.groupOrder=y,b.renderOrder=d.renderOrder,b.z=p,b.group=m),e++,b}function l(d,f,g,y,p,m,b){b.reversedDepth===!0&&(p=-p);let E=a(d,f,g,y,p,m);g.transmission>0?n.push(E):g.transparent===!0?i.push(E):t.push(E)}function c(d,f,g,y,p,m){let b=a(d,f,g,y,p,m);g.transmission>0?n.unshift(b):g.transparent===!0?i.unshift(b):t.unshift(b)}function h(d,f){t.length>1&&t.sort(d||Ab),n.length>1&&n.sort(f||Wp),i.length>1&&i.sort(f||Wp)}function u(){for(let d=e,f=s.length;d<f;d++){let g=s[d];if(g.id===null)break;g.id=null,g.object=null,g.geometry=null,g.material=null,g.group=null}}return{opaque:t,transmissive:n,transparent:i,init:r,push:l,unshift:c,finish:u,sort:h}}function Eb(){let s=new WeakMap;function e(n,i){let r=s.get(n),o;return r===void 0?(o=new Xp,s.set(n,[o])):i>=r.length?(o=new Xp,r.push(o)):o=r[i],o}function t(){s=new WeakMap}return{get:e,dispose:t}}function Rb(){let s={};return{get:function(e){if(s[e.id]!==void 0)return s[e.id];let t;switch(e.type){case"SunLight":case"DirectionalLight":t={direction:new S,color:new ve};break;case"SpotLight":t={position:new S,direction:new S,color:new ve,distance:0,coneCos:0,penumbraCos:0,decay:0};break;case"PointLight":t={position:new S,color:new ve,distance:0,decay:0};break;case"HemisphereLight":t={direction:new S,skyColor:new ve,groundColor:new ve};break;case"RectAreaLight":t={color:new ve,position:new S,halfWidth:new S,halfHeight:new S};break}return s[e.id]=t,t}}}function Cb(){let s={};return{get:function(e){if(s[e.id]!==void 0)return s[e.id];let t;switch(e.type){case"SunLight":case"DirectionalLight":t={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new ye};break;case"SpotLight":t={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new ye};break;case"PointLight":t={shadowIntensity:1,shadowBias:0,shadowNormalBias:0,shadowRadius:1,shadowMapSize:new ye,shadowCameraNear:1,shadowCameraFar:1e3};break}return s[e.id]=t,t}}}var Pb=0;function Ib(s,e){return(e.castShadow?2:0)-(s.castShadow?2:0)+(e.map?1:0)-(s.map?1:0)}function Lb(s){let e=new Rb,t=Cb(),n={version:0,hash:{sunLength:-1,directionalLength:-1,pointLength:-1,spotLength:-1,rectAreaLength:-1,hemiLength:-1,numSunShadows:-1,numDirectionalShadows:-1,numPointShadows:-1,numSpotShadows:-1,numSpotMaps:-1,numLightProbes:-1},ambient:[0,0,0],probe:[],sun:[],sunShadow:[],sunShadowMap:[],sunShadowMatrix:[],sunShadowCascade:[],directional:[],directionalShadow:[],directionalShadowMap:[],directionalShadowMatrix:[],spot:[],spotLightMap:[],spotShadow:[],spotShadowMap:[],spotLightMatrix:[],rectArea:[],rectAreaLTC1:null,rectAreaLTC2:null,point:[],pointShadow:[],pointShadowMap:[],pointShadowMatrix:[],hemi:[],numSpotLightShadowsWithMaps:0,numLightProbes:0};for(let c=0;c<9;c++)n.probe.push(new S);let i=new S,r=new _e,o=new _e;function a(c){let h=0,u=0,d=0;for(let k=0;k<9;k++)n.probe[k].set(0,0,0);let f=0,g=0,y=0,p=0,m=0,b=0,E=0,M=0,R=0,T=0,x=0,w=0,O=0,I=0;c.sort(Ib);for(let k=0,V=c.length;k<V;k++){let P=c[k],G=P.color,q=P.intensity,H=P.distance,te=null;if(P.shadow&&P.shadow.map&&(P.shadow.map.texture.format===Ji?te=P.shadow.map.texture:te=P.shadow.map.depthTexture||P.shadow.map.texture),P.isAmbientLight)h+=G.r*q,u+=G.g*q,d+=G.b*q;else if(P.isLightProbe){for(let X=0;X<9;X++)n.probe[X].addScaledVector(P.sh.coefficients[X],q);I++}else if(P.isSunLight){let X=e.get(P);if(X.color.copy(P.color).multiplyScalar(P.intensity),P.castShadow){let J=P.shadow,Q=t.get(P);Q.shadowIntensity=J.intensity,Q.shadowBias=J.bias,Q.shadowNormalBias=J.normalBias,Q.shadowRadius=J.radius,Q.shadowMapSize.copy(J.mapSize).multiply(J.getFrameExtents()),n.sunShadow[g]=Q,n.sunShadowMap[g]=te;let Te=J.getViewportCount();for(let Be=0;Be<Te;Be++)n.sunShadowMatrix[y+Be]=J.getMatrix(Be),n.sunShadowCascade[y+Be]=J._cascadeData[Be];y+=Te,g++}n.sun[f]=X,f++}else if(P.isDirectionalLight){let X=e.get(P);if(X.color.copy(P.color).multiplyScalar(P.intensity),P.castShadow){let J=P.shadow,Q=t.get(P);Q.shadowIntensity=J.intensity,Q.shadowBias=J.bias,Q.shadowNormalBias=J.normalBias,Q.shadowRadius=J.radius,Q.shadowMapSize=J.mapSize,n.directionalShadow[p]=Q,n.directionalShadowMap[p]=te,n.directionalShadowMatrix[p]=P.shadow.matrix,R++}n.directional[p]=X,p++}else if(P.isSpotLight){let X=e.get(P);X.position.setFromMatrixPosition(P.matrixWorld),X.color.copy(G).multiplyScalar(q),X.distance=H,X.coneCos=Math.cos(P.angle),X.penumbraCos=Math.cos(P.angle*(1-P.penumbra)),X.decay=P.decay,n.spot[b]=X;let J=P.shadow;if(P.map&&(n.spotLightMap[w]=P.map,w++,J.updateMatrices(P),P.castShadow&&O++),n.spotLightMatrix[b]=J.matrix,P.castShadow){let Q=t.get(P);Q.shadowIntensity=J.intensity,Q.shadowBias=J.bias,Q.shadowNormalBias=J.normalBias,Q.shadowRadius=J.radius,Q.shadowMapSize=J.mapSize,n.spotShadow[b]=Q,n.spotShadowMap[b]=te,x++}b++}else if(P.isRectAreaLight){let X=e.get(P);X.color.copy(G).multiplyScalar(q),X.halfWidth.set(P.width*.5,0,0),X.halfHeight.set(0,P.height*.5,0),n.rectArea[E]=X,E++}else if(P.isPointLight){let X=e.get(P);if(X.color.copy(P.color).multiplyScalar(P.intensity),X.distance=P.distance,X.decay=P.decay,P.castShadow){let J=P.shadow,Q=t.get(P);Q.shadowIntensity=J.intensity,Q.shadowBias=J.bias,Q.shadowNormalBias=J.normalBias,Q.shadowRadius=J.radius,Q.shadowMapSize=J.mapSize,Q.shadowCameraNear=J.camera.near,Q.shadowCameraFar=J.camera.far,n.pointShadow[m]=Q,n.pointShadowMap[m]=te,n.pointShadowMatrix[m]=P.shadow.matrix,T++}n.point[m]=X,m++}else if(P.isHemisphereLight){let X=e.get(P);X.skyColor.copy(P.color).multiplyScalar(q),X.groundColor.copy(P.groundColor).multiplyScalar(q),n.hemi[M]=X,M++}}E>0&&(s.has("OES_texture_float_linear")===!0?(n.rectAreaLTC1=pe.LTC_FLOAT_1,n.rectAreaLTC2=pe.LTC_FLOAT_2):(n.rectAreaLTC1=pe.LTC_HALF_1,n.rectAreaLTC2=pe.LTC_HALF_2)),n.ambient[0]=h,n.ambient[1]=u,n.ambient[2]=d;let N=n.hash;(N.sunLength!==f||N.directionalLength!==p||N.pointLength!==m||N.spotLength!==b||N.rectAreaLength!==E||N.hemiLength!==M||N.numSunShadows!==g||N.numDirectionalShadows!==R||N.numPointShadows!==T||N.numSpotShadows!==x||N.numSpotMaps!==w||N.numLightProbes!==I)&&(n.sun.length=f,n.directional.length=p,n.spot.length=b,n.rectArea.length=E,n.point.length=m,n.hemi.length=M,n.sunShadow.length=g,n.sunShadowMap.length=g,n.sunShadowMatrix.length=y,n.sunShadowCascade.length=y,n.directionalShadow.length=R,n.directionalShadowMap.length=R,n.directionalShadowMatrix.length=R,n.pointShadow.length=T,n.pointShadowMap.length=T,n.pointShadowMatrix.length=T,n.spotShadow.length=x,n.spotShadowMap.length=x,n.spotLightMatrix.length=x+w-O,n.spotLightMap.length=w,n.numSpotLightShadowsWithMaps=O,n.numLightProbes=I,N.sunLength=f,N.directionalLength=p,N.pointLength=m,N.spotLength=b,N.rectAreaLength=E,N.hemiLength=M,N.numSunShadows=g,N.numDirectionalShadows=R,N.numPointShadows=T,N.numSpotShadows=x,N.numSpotMaps=w,N.numLightProbes=I,n.version=Pb++)}function l(c,h){let u=0,d=0,f=0,g=0,y=0,p=0,m=h.matrixWorldInverse;for(let b=0,E=c.length;b<E;b++){let M=c[b];if(M.isSunLight){let R=n.sun[u];R.direction.setFromMatrixPosition(M.matrixWorld),R.direction.transformDirection(m),u++}else if(M.isDirectionalLight){let R=n.directional[d];R.direction.setFromMatrixPosition(M.matrixWorld),i.setFromMatrixPosition(M.target.matrixWorld),R.direction.sub(i),R.direction.transformDirection(m),d++}else if(M.isSpotLight){let R=n.spot[g];R.position.setFromMatrixPosition(M.matrixWorld),R.position.applyMatrix4(m),R.direction.setFromMatrixPosition(M.matrixWorld),i.setFromMatrixPosition(M.target.matrixWorld),R.direction.sub(i),R.direction.transformDirection(m),g++}else if(M.isRectAreaLight){let R=n.rectArea[y];R.position.setFromMatrixPosition(M.matrixWorld),R.position.applyMatrix4(m),o.identity(),r.copy(M.matrixWorld),r.premultiply(m),o.extractRotation(r),R.halfWidth.set(M.width*.5,0,0),R.halfHeight.set(0,M.height*.5,0),R.halfWidth.applyMatrix4(o),R.halfHeight.applyMatrix4(o),y++}else if(M.isPointLight){let R=n.point[f];R.position.setFromMatrixPosition(M.matrixWorld),R.position.applyMatrix4(m),f++}else if(M.isHemisphereLight){let R=n.hemi[p];R.direction.setFromMatrixPosition(M.matrixWorld),R.direction.transformDirection(m),p++}}}return{setup:a,setupView:l,state:n}}function qp(s){let e=new Lb(s),t=[],n=[],i=[];function r(u){h.camera=u,t.length=0,n.length=0,i.length=0}function o(u){u.isLightProbeGrid?i.push(u):t.push(u)}function a(u){n.push(u)}function l(){e.setup(t),i.sort((u,d)=>u.priority-d.priority||u.id-d.id)}function c(u){e.setupView(t,u)}let h={lightsArray:t,shadowsArray:n,lightProbeGridArray:i,camera:null,lights:e,transmissionRenderTarget:{},textureUnits:0};return{init:r,state:h,setupLights:l,setupLightsView:c,pushLight:o,pushShadow:a}}function Db(s){let e=new WeakMap;function t(i,r=0){let o=e.get(i),a;return o===void 0?(a=new qp(s),e.set(i,[a])):r>=o.length?(a=new qp(s),o.push(a)):a=o[r],a}function n(){e=new WeakMap}return{get:t,dispose:n}}var Nb=`void main() {
	gl_Position = vec4( position, 1.0 );
}`,Ob=`uniform sampler2D shadow_pass;
uniform vec2 resolution;
uniform float radius;
void main() {
	const float samples = float( VSM_SAMPLES );
	float mean = 0.0;
	float squared_mean = 0.0;
	float uvStride = samples <= 1.0 ? 0.0 : 2.0 / ( samples - 1.0 );
	float uvStart = samples <= 1.0 ? 0.0 : - 1.0;
	for ( float i = 0.0; i < samples; i ++ ) {
		float uvOffset = uvStart + i * uvStride;
		#ifdef HORIZONTAL_PASS
			vec2 distribution = texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( uvOffset, 0.0 ) * radius ) / resolution ).rg;
			mean += distribution.x;
			squared_mean += distribution.y * distribution.y + distribution.x * distribution.x;
		#else
			float depth = texture2D( shadow_pass, ( gl_FragCoord.xy + vec2( 0.0, uvOffset ) * radius ) / resolution ).r;
			mean += depth;
			squared_mean += depth * depth;
		#endif
	}
	mean = mean / samples;
	squared_mean = squared_mean / samples;
	float std_dev = sqrt( max( 0.0, squared_mean - mean * mean ) );
	gl_FragColor = vec4( mean, std_dev, 0.0, 1.0 );
}`,Ub=[new S(1,0,0),new S(-1,0,0),new S(0,1,0),new S(0,-1,0),new S(0,0,1),new S(0,0,-1)],Fb=[new S(0,-1,0),new S(0,-1,0),new S(0,0,1),new S(0,0,-1),new S(0,-1,0),new S(0,-1,0)],$p=new _e,Po=new S,Ru=new S;function kb(s,e,t){let n=new Vi,i=new ye,r=new ye,o=new at,a=new Ga,l=new Va,c={},h=t.maxTextureSize,u={[ei]:Kt,[Kt]:ei,[It]:It},d=new dn({defines:{VSM_SAMPLES:8},uniforms:{shadow_pass:{value:null},resolution:{value:new ye},radius:{value:4}},vertexShader:Nb,fragmentShader:Ob}),f=d.clone();f.defines.HORIZONTAL_PASS=1;let g=new Ye;g.setAttribute("position",new bt(new Float32Array([-1,-1,.5,3,-1,.5,-1,3,.5]),3));let y=new ue(g,d),p=this;this.enabled=!1,this.autoUpdate=!0,this.needsUpdate=!1,this.type=bs;let m=this.type;this.render=function(T,x,w){if(p.enabled===!1||p.autoUpdate===!1&&p.needsUpdate===!1||T.length===0)return;this.type===Hf&&(Ee("WebGLShadowMap: PCFSoftShadowMap has been removed. Using PCFShadowMap instead."),this.type=bs);let O=s.getRenderTarget(),I=s.getActiveCubeFace(),N=s.getActiveMipmapLevel(),k=s.state;k.setBlending(Ms),k.buffers.depth.getReversed()===!0?k.buffers.color.setClear(0,0,0,0):k.buffers.color.setClear(1,1,1,1),k.buffers.depth.setTest(!0),k.setScissorTest(!1);let V=m!==this.type;V&&x.traverse(function(P){P.material&&(Array.isArray(P.material)?P.material.forEach(G=>G.needsUpdate=!0):P.material.needsUpdate=!0)});for(let P=0,G=T.length;P<G;P++){let q=T[P],H=q.shadow;if(H===void 0){Ee("WebGLShadowMap:",q,"has no shadow.");continue}if(H.autoUpdate===!1&&H.needsUpdate===!1)continue;i.copy(H.mapSize);let te=H.getFrameExtents();i.multiply(te),r.copy(H.mapSize),(i.x>h||i.y>h)&&(i.x>h&&(r.x=Math.floor(h/te.x),i.x=r.x*te.x,H.mapSize.x=r.x),i.y>h&&(r.y=Math.floor(h/te.y),i.y=r.y*te.y,H.mapSize.y=r.y));let X=s.state.buffers.depth.getReversed();if(H.camera._reversedDepth=X,H.map===null||V===!0){if(H.map!==null&&(H.map.depthTexture!==null&&(H.map.depthTexture.dispose(),H.map.depthTexture=null),H.map.dispose()),this.type===yr){if(q.isPointLight){Ee("WebGLShadowMap: VSM shadow maps are not supported for PointLights. Use PCF or BasicShadowMap instead.");continue}H.map=new Tt(i.x,i.y,{format:Ji,type:bn,minFilter:St,magFilter:St,generateMipmaps:!1}),H.map.texture.name=q.name+".shadowMap",H.map.depthTexture=new zn(i.x,i.y,_n),H.map.depthTexture.name=q.name+".shadowMapDepth",H.map.depthTexture.format=xi,H.map.depthTexture.compareFunction=null,H.map.depthTexture.minFilter=gt,H.map.depthTexture.magFilter=gt}else q.isPointLight?(H.map=new Lo(i.x),H.map.depthTexture=new oo(i.x,Vn)):(H.map=new Tt(i.x,i.y),H.map.depthTexture=new zn(i.x,i.y,Vn)),H.map.depthTexture.name=q.name+".shadowMap",H.map.depthTexture.format=xi,this.type===bs?(H.map.depthTexture.compareFunction=X?mu:pu,H.map.depthTexture.minFilter=St,H.map.depthTexture.magFilter=St):(H.map.depthTexture.compareFunction=null,H.map.depthTexture.minFilter=gt,H.map.depthTexture.magFilter=gt);H.camera.updateProjectionMatrix()}H.map.isWebGLCubeRenderTarget!==!0&&(H.map.width!==i.x||H.map.height!==i.y)&&H.map.setSize(i.x,i.y);let J=H.map.isWebGLCubeRenderTarget?6:H.getViewportCount();q.isPointLight!==!0&&H.updateMatrices(q,w);let Q=(H.camera.layers.mask&4294967294)!==0?H.camera.layers:w.layers;for(let Te=0;Te<J;Te++){let Be=H.getCamera(Te);if(q.isPointLight){let K=H.camera,me=H.matrix,Me=q.distance||K.far;Me!==K.far&&(K.far=Me,K.updateProjectionMatrix()),Po.setFromMatrixPosition(q.matrixWorld),K.position.copy(Po),Ru.copy(K.position),Ru.add(Ub[Te]),K.up.copy(Fb[Te]),K.lookAt(Ru),K.updateMatrixWorld(),me.makeTranslation(-Po.x,-Po.y,-Po.z),$p.multiplyMatrices(K.projectionMatrix,K.matrixWorldInverse),H._frustum.setFromProjectionMatrix($p,K.coordinateSystem,K.reversedDepth)}if(H.map.isWebGLCubeRenderTarget)s.setRenderTarget(H.map,Te),s.clear();else{Te===0&&(s.setRenderTarget(H.map),s.clear());let K=H.getViewport(Te);o.set(r.x*K.x,r.y*K.y,r.x*K.z,r.y*K.w),k.viewport(o)}n=H.getFrustum(Te),M(x,w,Be,q,Q,this.type)}H.isPointLightShadow!==!0&&this.type===yr&&b(H,w),H.needsUpdate=!1}m=this.type,p.needsUpdate=!1,s.setRenderTarget(O,I,N)};function b(T,x){let w=e.update(y);d.defines.VSM_SAMPLES!==T.blurSamples&&(d.defines.VSM_SAMPLES=T.blurSamples,f.defines.VSM_SAMPLES=T.blurSamples,d.needsUpdate=!0,f.needsUpdate=!0),T.mapPass===null?T.mapPass=new Tt(i.x,i.y,{format:Ji,type:bn}):(T.mapPass.width!==T.map.width||T.mapPass.height!==T.map.height)&&T.mapPass.setSize(T.map.width,T.map.height),d.uniforms.shadow_pass.value=T.map.depthTexture,d.uniforms.resolution.value.set(T.map.width,T.map.height),d.uniforms.radius.value=T.radius,s.setRenderTarget(T.mapPass),s.clear(),s.renderBufferDirect(x,null,w,d,y,null),f.uniforms.shadow_pass.value=T.mapPass.texture,f.uniforms.resolution.value.set(T.map.width,T.map.height),f.uniforms.radius.value=T.radius,s.setRenderTarget(T.map),s.clear(),s.renderBufferDirect(x,null,w,f,y,null)}function E(T,x,w,O){let I=null,N=w.isPointLight===!0?T.customDistanceMaterial:T.customDepthMaterial;if(N!==void 0)I=N;else if(I=w.isPointLight===!0?l:a,s.localClippingEnabled&&x.clipShadows===!0&&Array.isArray(x.clippingPlanes)&&x.clippingPlanes.length!==0||x.displacementMap&&x.displacementScale!==0||x.alphaMap&&x.alphaTest>0||x.map&&x.alphaTest>0||x.alphaToCoverage===!0){let k=I.uuid,V=x.uuid,P=c[k];P===void 0&&(P={},c[k]=P);let G=P[V];G===void 0&&(G=I.clone(),P[V]=G,x.addEventListener("dispose",R)),I=G}if(I.visible=x.visible,I.wireframe=x.wireframe,O===yr?I.side=x.shadowSide!==null?x.shadowSide:x.side:I.side=x.shadowSide!==null?x.shadowSide:u[x.side],I.alphaMap=x.alphaMap,I.alphaTest=x.alphaToCoverage===!0?.5:x.alphaTest,I.map=x.map,I.clipShadows=x.clipShadows,I.clippingPlanes=x.clippingPlanes,I.clipIntersection=x.clipIntersection,I.displacementMap=x.displacementMap,I.displacementScale=x.displacementScale,I.displacementBias=x.displacementBias,I.wireframeLinewidth=x.wireframeLinewidth,I.linewidth=x.linewidth,w.isPointLight===!0&&I.isMeshDistanceMaterial===!0){let k=s.properties.get(I);k.light=w}return I}function M(T,x,w,O,I,N){if(T.visible===!1)return;if(T.layers.test(I)&&(T.isMesh||T.isLine||T.isPoints)&&(T.castShadow||T.receiveShadow&&N===yr)&&(!T.frustumCulled||T.intersectsFrustum(n))){T.modelViewMatrix.multiplyMatrices(w.matrixWorldInverse,T.matrixWorld);let P=e.update(T),G=T.material;if(Array.isArray(G)){let q=P.groups;for(let H=0,te=q.length;H<te;H++){let X=q[H],J=G[X.materialIndex];if(J&&J.visible){let Q=E(T,J,O,N);T.onBeforeShadow(s,T,x,w,P,Q,X),s.renderBufferDirect(w,null,P,Q,T,X),T.onAfterShadow(s,T,x,w,P,Q,X)}}}else if(G.visible){let q=E(T,G,O,N);T.onBeforeShadow(s,T,x,w,P,q,null),s.renderBufferDirect(w,null,P,q,T,null),T.onAfterShadow(s,T,x,w,P,q,null)}}let V=T.children;for(let P=0,G=V.length;P<G;P++)M(V[P],x,w,O,I,N)}function R(T){T.target.removeEventListener("dispose",R);for(let w in c){let O=c[w],I=T.target.uuid;I in O&&(O[I].dispose(),delete O[I])}}}function Bb(s,e){function t(){let C=!1,j=new at,W=null,ae=new at(0,0,0,0);return{setMask:function(ie){W!==ie&&!C&&(s.colorMask(ie,ie,ie,ie),W=ie)},setLocked:function(ie){C=ie},setClear:function(ie,re,Re,Ve,ne){ne===!0&&(ie*=Ve,re*=Ve,Re*=Ve),j.set(ie,re,Re,Ve),ae.equals(j)===!1&&(s.clearColor(ie,re,Re,Ve),ae.copy(j))},reset:function(){C=!1,W=null,ae.set(-1,0,0,0)}}}function n(){let C=!1,j=!1,W=null,ae=null,ie=null;return{setReversed:function(re){if(j!==re){let Re=e.get("EXT_clip_control");re?Re.clipControlEXT(Re.LOWER_LEFT_EXT,Re.ZERO_TO_ONE_EXT):Re.clipControlEXT(Re.LOWER_LEFT_EXT,Re.NEGATIVE_ONE_TO_ONE_EXT),j=re;let Ve=ie;ie=null,this.setClear(Ve)}},getReversed:function(){return j},setTest:function(re){re?ge(s.DEPTH_TEST):He(s.DEPTH_TEST)},setMask:function(re){W!==re&&!C&&(s.depthMask(re),W=re)},setFunc:function(re){if(j&&(re=bp[re]),ae!==re){switch(re){case Ca:s.depthFunc(s.NEVER);break;case nr:s.depthFunc(s.ALWAYS);break;case Pa:s.depthFunc(s.LESS);break;case ir:s.depthFunc(s.LEQUAL);break;case Ia:s.depthFunc(s.EQUAL);break;case La:s.depthFunc(s.GEQUAL);break;case Da:s.depthFunc(s.GREATER);break;case Na:s.depthFunc(s.NOTEQUAL);break;default:s.depthFunc(s.LEQUAL)}ae=re}},setLocked:function(re){C=re},setClear:function(re){ie!==re&&(ie=re,j&&(re=1-re),s.clearDepth(re))},reset:function(){C=!1,W=null,ae=null,ie=null,j=!1}}}function i(){let C=!1,j=null,W=null,ae=null,ie=null,re=null,Re=null,Ve=null,ne=null;return{setTest:function(Ce){C||(Ce?ge(s.STENCIL_TEST):He(s.STENCIL_TEST))},setMask:function(Ce){j!==Ce&&!C&&(s.stencilMask(Ce),j=Ce)},setFunc:function(Ce,Ge,fe){(W!==Ce||ae!==Ge||ie!==fe)&&(s.stencilFunc(Ce,Ge,fe),W=Ce,ae=Ge,ie=fe)},setOp:function(Ce,Ge,fe){(re!==Ce||Re!==Ge||Ve!==fe)&&(s.stencilOp(Ce,Ge,fe),re=Ce,Re=Ge,Ve=fe)},setLocked:function(Ce){C=Ce},setClear:function(Ce){ne!==Ce&&(s.clearStencil(Ce),ne=Ce)},reset:function(){C=!1,j=null,W=null,ae=null,ie=null,re=null,Re=null,Ve=null,ne=null}}}let r=new t,o=new n,a=new i,l={},c=new WeakMap,h={},u={},d={},f=new WeakMap,g=[],y=null,p=!1,m=null,b=null,E=null,M=null,R=null,T=null,x=null,w=new ve(0,0,0),O=0,I=!1,N=null,k=null,V=null,P=null,G=null,q=s.getParameter(s.MAX_COMBINED_TEXTURE_IMAGE_UNITS),H=!1,te=0,X=s.getParameter(s.VERSION);X.indexOf("WebGL")!==-1?(te=parseFloat(/^WebGL (\d)/.exec(X)[1]),H=te>=1):X.indexOf("OpenGL ES")!==-1&&(te=parseFloat(/^OpenGL ES (\d)/.exec(X)[1]),H=te>=2);let J=null,Q={},Te=s.getParameter(s.SCISSOR_BOX),Be=s.getParameter(s.VIEWPORT),K=new at().fromArray(Te),me=new at().fromArray(Be);function Me(C,j,W,ae){let ie=new Uint8Array(4),re=s.createTexture();s.bindTexture(C,re),s.texParameteri(C,s.TEXTURE_MIN_FILTER,s.NEAREST),s.texParameteri(C,s.TEXTURE_MAG_FILTER,s.NEAREST);for(let Re=0;Re<W;Re++)C===s.TEXTURE_3D||C===s.TEXTURE_2D_ARRAY?s.texImage3D(j,0,s.RGBA,1,1,ae,0,s.RGBA,s.UNSIGNED_BYTE,ie):s.texImage2D(j+Re,0,s.RGBA,1,1,0,s.RGBA,s.UNSIGNED_BYTE,ie);return re}let Ie={};Ie[s.TEXTURE_2D]=Me(s.TEXTURE_2D,s.TEXTURE_2D,1),Ie[s.TEXTURE_CUBE_MAP]=Me(s.TEXTURE_CUBE_MAP,s.TEXTURE_CUBE_MAP_POSITIVE_X,6),Ie[s.TEXTURE_2D_ARRAY]=Me(s.TEXTURE_2D_ARRAY,s.TEXTURE_2D_ARRAY,1,1),Ie[s.TEXTURE_3D]=Me(s.TEXTURE_3D,s.TEXTURE_3D,1,1),r.setClear(0,0,0,1),o.setClear(1),a.setClear(0),ge(s.DEPTH_TEST),o.setFunc(ir),hn(!1),xt(Yh),ge(s.CULL_FACE),Xt(Ms);function ge(C){h[C]!==!0&&(s.enable(C),h[C]=!0)}function He(C){h[C]!==!1&&(s.disable(C),h[C]=!1)}function Rt(C,j){return d[C]!==j?(s.bindFramebuffer(C,j),d[C]=j,C===s.DRAW_FRAMEBUFFER&&(d[s.FRAMEBUFFER]=j),C===s.FRAMEBUFFER&&(d[s.DRAW_FRAMEBUFFER]=j),!0):!1}function Ne(C,j){let W=g,ae=!1;if(C){W=f.get(j),W===void 0&&(W=[],f.set(j,W));let ie=C.textures;if(W.length!==ie.length||W[0]!==s.COLOR_ATTACHMENT0){for(let re=0,Re=ie.length;re<Re;re++)W[re]=s.COLOR_ATTACHMENT0+re;W.length=ie.length,ae=!0}}else W[0]!==s.BACK&&(W[0]=s.BACK,ae=!0);ae&&s.drawBuffers(W)}function st(C){return y!==C?(s.useProgram(C),y=C,!0):!1}let ct={[ws]:s.FUNC_ADD,[Vf]:s.FUNC_SUBTRACT,[Wf]:s.FUNC_REVERSE_SUBTRACT};ct[Xf]=s.MIN,ct[qf]=s.MAX;let Ke={[$f]:s.ZERO,[Yf]:s.ONE,[Kf]:s.SRC_COLOR,[Jh]:s.SRC_ALPHA,[tp]:s.SRC_ALPHA_SATURATE,[Qf]:s.DST_COLOR,[Zf]:s.DST_ALPHA,[jf]:s.ONE_MINUS_SRC_COLOR,[Qh]:s.ONE_MINUS_SRC_ALPHA,[ep]:s.ONE_MINUS_DST_COLOR,[Jf]:s.ONE_MINUS_DST_ALPHA,[np]:s.CONSTANT_COLOR,[ip]:s.ONE_MINUS_CONSTANT_COLOR,[sp]:s.CONSTANT_ALPHA,[rp]:s.ONE_MINUS_CONSTANT_ALPHA};function Xt(C,j,W,ae,ie,re,Re,Ve,ne,Ce){if(C===Ms){p===!0&&(He(s.BLEND),p=!1);return}if(p===!1&&(ge(s.BLEND),p=!0),C!==Gf){if(C!==m||Ce!==I){if((b!==ws||R!==ws)&&(s.blendEquation(s.FUNC_ADD),b=ws,R=ws),Ce)switch(C){case vr:s.blendFuncSeparate(s.ONE,s.ONE_MINUS_SRC_ALPHA,s.ONE,s.ONE_MINUS_SRC_ALPHA);break;case Kh:s.blendFunc(s.ONE,s.ONE);break;case jh:s.blendFuncSeparate(s.ZERO,s.ONE_MINUS_SRC_COLOR,s.ZERO,s.ONE);break;case Zh:s.blendFuncSeparate(s.DST_COLOR,s.ONE_MINUS_SRC_ALPHA,s.ZERO,s.ONE);break;default:Oe("WebGLState: Invalid blending: ",C);break}else switch(C){case vr:s.blendFuncSeparate(s.SRC_ALPHA,s.ONE_MINUS_SRC_ALPHA,s.ONE,s.ONE_MINUS_SRC_ALPHA);break;case Kh:s.blendFuncSeparate(s.SRC_ALPHA,s.ONE,s.ONE,s.ONE);break;case jh:Oe("WebGLState: SubtractiveBlending requires material.premultipliedAlpha = true");break;case Zh:Oe("WebGLState: MultiplyBlending requires material.premultipliedAlpha = true");break;default:Oe("WebGLState: Invalid blending: ",C);break}E=null,M=null,T=null,x=null,w.set(0,0,0),O=0,m=C,I=Ce}return}ie=ie||j,re=re||W,Re=Re||ae,(j!==b||ie!==R)&&(s.blendEquationSeparate(ct[j],ct[ie]),b=j,R=ie),(W!==E||ae!==M||re!==T||Re!==x)&&(s.blendFuncSeparate(Ke[W],Ke[ae],Ke[re],Ke[Re]),E=W,M=ae,T=re,x=Re),(Ve.equals(w)===!1||ne!==O)&&(s.blendColor(Ve.r,Ve.g,Ve.b,ne),w.copy(Ve),O=ne),m=C,I=!1}function Lt(C,j){C.side===It?He(s.CULL_FACE):ge(s.CULL_FACE);let W=C.side===Kt;j&&(W=!W),hn(W),C.blending===vr&&C.transparent===!1?Xt(Ms):Xt(C.blending,C.blendEquation,C.blendSrc,C.blendDst,C.blendEquationAlpha,C.blendSrcAlpha,C.blendDstAlpha,C.blendColor,C.blendAlpha,C.premultipliedAlpha),o.setFunc(C.depthFunc),o.setTest(C.depthTest),o.setMask(C.depthWrite),r.setMask(C.colorWrite);let ae=C.stencilWrite;a.setTest(ae),ae&&(a.setMask(C.stencilWriteMask),a.setFunc(C.stencilFunc,C.stencilRef,C.stencilFuncMask),a.setOp(C.stencilFail,C.stencilZFail,C.stencilZPass)),Bt(C.polygonOffset,C.polygonOffsetFactor,C.polygonOffsetUnits),C.alphaToCoverage===!0?ge(s.SAMPLE_ALPHA_TO_COVERAGE):He(s.SAMPLE_ALPHA_TO_COVERAGE)}function hn(C){N!==C&&(C?s.frontFace(s.CW):s.frontFace(s.CCW),N=C)}function xt(C){C!==Bf?(ge(s.CULL_FACE),C!==k&&(C===Yh?s.cullFace(s.BACK):C===zf?s.cullFace(s.FRONT):s.cullFace(s.FRONT_AND_BACK))):He(s.CULL_FACE),k=C}function qn(C){C!==V&&(H&&s.lineWidth(C),V=C)}function Bt(C,j,W){C?(ge(s.POLYGON_OFFSET_FILL),(P!==j||G!==W)&&(P=j,G=W,o.getReversed()&&(j=-j,W=-W),s.polygonOffset(j,W))):He(s.POLYGON_OFFSET_FILL)}function Sn(C){C?ge(s.SCISSOR_TEST):He(s.SCISSOR_TEST)}function Tn(C){C===void 0&&(C=s.TEXTURE0+q-1),J!==C&&(s.activeTexture(C),J=C)}function An(C,j,W){W===void 0&&(J===null?W=s.TEXTURE0+q-1:W=J);let ae=Q[W];ae===void 0&&(ae={type:void 0,texture:void 0},Q[W]=ae),(ae.type!==C||ae.texture!==j)&&(J!==W&&(s.activeTexture(W),J=W),s.bindTexture(C,j||Ie[C]),ae.type=C,ae.texture=j)}function D(){let C=Q[J];C!==void 0&&C.type!==void 0&&(s.bindTexture(C.type,null),C.type=void 0,C.texture=void 0)}function En(){try{s.compressedTexImage2D(...arguments)}catch(C){Oe("WebGLState:",C)}}function pt(){try{s.compressedTexImage3D(...arguments)}catch(C){Oe("WebGLState:",C)}}function mt(){try{s.texSubImage2D(...arguments)}catch(C){Oe("WebGLState:",C)}}function de(){try{s.texSubImage3D(...arguments)}catch(C){Oe("WebGLState:",C)}}function Dt(){try{s.compressedTexSubImage2D(...arguments)}catch(C){Oe("WebGLState:",C)}}function Le(){try{s.compressedTexSubImage3D(...arguments)}catch(C){Oe("WebGLState:",C)}}function ke(){try{s.texStorage2D(...arguments)}catch(C){Oe("WebGLState:",C)}}function A(){try{s.texStorage3D(...arguments)}catch(C){Oe("WebGLState:",C)}}function v(){try{s.texImage2D(...arguments)}catch(C){Oe("WebGLState:",C)}}function F(){try{s.texImage3D(...arguments)}catch(C){Oe("WebGLState:",C)}}function ee(C){return u[C]!==void 0?u[C]:s.getParameter(C)}function Z(C,j){u[C]!==j&&(s.pixelStorei(C,j),u[C]=j)}function se(C){K.equals(C)===!1&&(s.scissor(C.x,C.y,C.z,C.w),K.copy(C))}function ce(C){me.equals(C)===!1&&(s.viewport(C.x,C.y,C.z,C.w),me.copy(C))}function $(C,j){let W=c.get(j);W===void 0&&(W=new WeakMap,c.set(j,W));let ae=W.get(C);ae===void 0&&(ae=s.getUniformBlockIndex(j,C.name),s.uniformBlockBinding(j,ae,ae),W.set(C,ae))}function Y(C,j,W){let ie=c.get(j).get(C);l[ie]!==W&&(s.bindBufferBase(s.UNIFORM_BUFFER,ie,W),l[ie]=W)}function oe(){s.disable(s.BLEND),s.disable(s.CULL_FACE),s.disable(s.DEPTH_TEST),s.disable(s.POLYGON_OFFSET_FILL),s.disable(s.SCISSOR_TEST),s.disable(s.STENCIL_TEST),s.disable(s.SAMPLE_ALPHA_TO_COVERAGE),s.blendEquation(s.FUNC_ADD),s.blendFunc(s.ONE,s.ZERO),s.blendFuncSeparate(s.ONE,s.ZERO,s.ONE,s.ZERO),s.blendColor(0,0,0,0),s.colorMask(!0,!0,!0,!0),s.clearColor(0,0,0,0),s.depthMask(!0),s.depthFunc(s.LESS),o.setReversed(!1),s.clearDepth(1),s.stencilMask(4294967295),s.stencilFunc(s.ALWAYS,0,4294967295),s.stencilOp(s.KEEP,s.KEEP,s.KEEP),s.clearStencil(0),s.cullFace(s.BACK),s.frontFace(s.CCW),s.polygonOffset(0,0),s.activeTexture(s.TEXTURE0),s.bindFramebuffer(s.FRAMEBUFFER,null),s.bindFramebuffer(s.DRAW_FRAMEBUFFER,null),s.bindFramebuffer(s.READ_FRAMEBUFFER,null),s.useProgram(null),s.lineWidth(1),s.scissor(0,0,s.canvas.width,s.canvas.height),s.viewport(0,0,s.canvas.width,s.canvas.height),s.pixelStorei(s.PACK_ALIGNMENT,4),s.pixelStorei(s.UNPACK_ALIGNMENT,4),s.pixelStorei(s.UNPACK_FLIP_Y_WEBGL,!1),s.pixelStorei(s.UNPACK_PREMULTIPLY_ALPHA_WEBGL,!1),s.pixelStorei(s.UNPACK_COLORSPACE_CONVERSION_WEBGL,s.BROWSER_DEFAULT_WEBGL),s.pixelStorei(s.PACK_ROW_LENGTH,0),s.pixelStorei(s.PACK_SKIP_PIXELS,0),s.pixelStorei(s.PACK_SKIP_ROWS,0),s.pixelStorei(s.UNPACK_ROW_LENGTH,0),s.pixelStorei(s.UNPACK_IMAGE_HEIGHT,0),s.pixelStorei(s.UNPACK_SKIP_PIXELS,0),s.pixelStorei(s.UNPACK_SKIP_ROWS,0),s.pixelStorei(s.UNPACK_SKIP_IMAGES,0),h={},u={},J=null,Q={},d={},l={},f=new WeakMap,g=[],y=null,p=!1,m=null,b=null,E=null,M=null,R=null,T=null,x=null,w=new ve(0,0,0),O=0,I=!1,N=null,k=null,V=null,P=null,G=null,K.set(0,0,s.canvas.width,s.canvas.height),me.set(0,0,s.canvas.width,s.canvas.height),r.reset(),o.reset(),a.reset()}return{buffers:{color:r,depth:o,stencil:a},enable:ge,disable:He,bindFramebuffer:Rt,drawBuffers:Ne,useProgram:st,setBlending:Xt,setMaterial:Lt,setFlipSided:hn,setCullFace:xt,setLineWidth:qn,setPolygonOffset:Bt,setScissorTest:Sn,activeTexture:Tn,bindTexture:An,unbindTexture:D,compressedTexImage2D:En,compressedTexImage3D:pt,texImage2D:v,texImage3D:F,pixelStorei:Z,getParameter:ee,updateUBOMapping:$,uniformBlockBinding:Y,texStorage2D:ke,texStorage3D:A,texSubImage2D:mt,texSubImage3D:de,compressedTexSubImage2D:Dt,compressedTexSubImage3D:Le,scissor:se,viewport:ce,reset:oe}}function zb(s,e,t,n,i,r,o){let a=e.has("WEBGL_multisampled_render_to_texture")?e.get("WEBGL_multisampled_render_to_texture"):null,l=typeof navigator>"u"?!1:/OculusBrowser/g.test(navigator.userAgent),c=new ye,h=new WeakMap,u=new Set,d,f=new WeakMap,g=new Set,y=new FinalizationRegistry(A=>g.delete(A)),p=!1;try{p=typeof OffscreenCanvas<"u"&&new OffscreenCanvas(1,1).getContext("2d")!==null}catch{}function m(A,v){return p?new OffscreenCanvas(A,v):rr("canvas")}function b(A,v,F){let ee=1,Z=ke(A);if((Z.width>F||Z.height>F)&&(ee=F/Math.max(Z.width,Z.height)),ee<1)if(typeof HTMLImageElement<"u"&&A instanceof HTMLImageElement||typeof HTMLCanvasElement<"u"&&A instanceof HTMLCanvasElement||typeof ImageBitmap<"u"&&A instanceof ImageBitmap||typeof VideoFrame<"u"&&A instanceof VideoFrame){let se=Math.floor(ee*Z.width),ce=Math.floor(ee*Z.height);d===void 0&&(d=m(se,ce));let $=v?m(se,ce):d;return $.width=se,$.height=ce,$.getContext("2d").drawImage(A,0,0,se,ce),Ee("WebGLRenderer: Texture has been resized from ("+Z.width+"x"+Z.height+") to ("+se+"x"+ce+")."),$}else return"data"in A&&Ee("WebGLRenderer: Image in DataTexture is too big ("+Z.width+"x"+Z.height+")."),A;return A}function E(A){return A.generateMipmaps}function M(A){s.generateMipmap(A)}function R(A){return A.isWebGLCubeRenderTarget?s.TEXTURE_CUBE_MAP:A.isWebGL3DRenderTarget?s.TEXTURE_3D:A.isWebGLArrayRenderTarget||A.isCompressedArrayTexture?s.TEXTURE_2D_ARRAY:s.TEXTURE_2D}function T(A,v,F,ee,Z,se=!1){if(A!==null){if(s[A]!==void 0)return s[A];Ee("WebGLRenderer: Attempt to use non-existing WebGL internal format '"+A+"'")}let ce;ee&&(ce=e.get("EXT_texture_norm16"),ce||Ee("WebGLRenderer: Unable to use normalized textures without EXT_texture_norm16 extension"));let $=v;if(v===s.RED&&(F===s.FLOAT&&($=s.R32F),F===s.HALF_FLOAT&&($=s.R16F),F===s.UNSIGNED_BYTE&&($=s.R8),F===s.UNSIGNED_SHORT&&ce&&($=ce.R16_EXT),F===s.SHORT&&ce&&($=ce.R16_SNORM_EXT)),v===s.RED_INTEGER&&(F===s.UNSIGNED_BYTE&&($=s.R8UI),F===s.UNSIGNED_SHORT&&($=s.R16UI),F===s.UNSIGNED_INT&&($=s.R32UI),F===s.BYTE&&($=s.R8I),F===s.SHORT&&($=s.R16I),F===s.INT&&($=s.R32I)),v===s.RG&&(F===s.FLOAT&&($=s.RG32F),F===s.HALF_FLOAT&&($=s.RG16F),F===s.UNSIGNED_BYTE&&($=s.RG8),F===s.UNSIGNED_SHORT&&ce&&($=ce.RG16_EXT),F===s.SHORT&&ce&&($=ce.RG16_SNORM_EXT)),v===s.RG_INTEGER&&(F===s.UNSIGNED_BYTE&&($=s.RG8UI),F===s.UNSIGNED_SHORT&&($=s.RG16UI),F===s.UNSIGNED_INT&&($=s.RG32UI),F===s.BYTE&&($=s.RG8I),F===s.SHORT&&($=s.RG16I),F===s.INT&&($=s.RG32I)),v===s.RGB_INTEGER&&(F===s.UNSIGNED_BYTE&&($=s.RGB8UI),F===s.UNSIGNED_SHORT&&($=s.RGB16UI),F===s.UNSIGNED_INT&&($=s.RGB32UI),F===s.BYTE&&($=s.RGB8I),F===s.SHORT&&($=s.RGB16I),F===s.INT&&($=s.RGB32I)),v===s.RGBA_INTEGER&&(F===s.UNSIGNED_BYTE&&($=s.RGBA8UI),F===s.UNSIGNED_SHORT&&($=s.RGBA16UI),F===s.UNSIGNED_INT&&($=s.RGBA32UI),F===s.BYTE&&($=s.RGBA8I),F===s.SHORT&&($=s.RGBA16I),F===s.INT&&($=s.RGBA32I)),v===s.RGB&&(F===s.UNSIGNED_SHORT&&ce&&($=ce.RGB16_EXT),F===s.SHORT&&ce&&($=ce.RGB16_SNORM_EXT),F===s.UNSIGNED_INT_5_9_9_9_REV&&($=s.RGB9_E5),F===s.UNSIGNED_INT_10F_11F_11F_REV&&($=s.R11F_G11F_B10F)),v===s.RGBA){let Y=se?jr:Xe.getTransfer(Z);F===s.FLOAT&&($=s.RGBA32F),F===s.HALF_FLOAT&&($=s.RGBA16F),F===s.UNSIGNED_BYTE&&($=Y===nt?s.SRGB8_ALPHA8:s.RGBA8),F===s.UNSIGNED_SHORT&&ce&&($=ce.RGBA16_EXT),F===s.SHORT&&ce&&($=ce.RGBA16_SNORM_EXT),F===s.UNSIGNED_SHORT_4_4_4_4&&($=s.RGBA4),F===s.UNSIGNED_SHORT_5_5_5_1&&($=s.RGB5_A1)}return($===s.R16F||$===s.R32F||$===s.RG16F||$===s.RG32F||$===s.RGBA16F||$===s.RGBA32F)&&e.get("EXT_color_buffer_float"),$}function x(A,v){let F;return A?v===null||v===Vn||v===As?F=s.DEPTH24_STENCIL8:v===_n?F=s.DEPTH32F_STENCIL8:v===Mr&&(F=s.DEPTH24_STENCIL8,Ee("DepthTexture: 16 bit depth attachment is not supported with stencil. Using 24-bit attachment.")):v===null||v===Vn||v===As?F=s.DEPTH_COMPONENT24:v===_n?F=s.DEPTH_COMPONENT32F:v===Mr&&(F=s.DEPTH_COMPONENT16),F}function w(A,v){return E(A)===!0||A.isFramebufferTexture&&A.minFilter!==gt&&A.minFilter!==St?Math.log2(Math.max(v.width,v.height))+1:A.mipmaps.length>0?A.mipmaps.length:A.isCompressedTexture&&Array.isArray(A.image)?v.mipmaps.length:1}function O(A){let v=new WeakRef(A);n.get(A).__ref=v,g.add(v),y.register(A,v,v)}function I(A){let v=n.get(A).__ref;v!==void 0&&(g.delete(v),y.unregister(v))}function N(A){V(A.target)}function k(A){P(A.target)}function V(A){A.removeEventListener("dispose",N),I(A),q(A),A.isVideoTexture&&h.delete(A),A.isHTMLTexture&&u.delete(A)}function P(A){A.removeEventListener("dispose",k),I(A),te(A)}function G(){for(let A of g){let v=A.deref();v!==void 0&&(v.isRenderTarget===!0?P(v):V(v))}g.clear(),u.clear()}function q(A){let v=n.get(A);if(v.__webglInit===void 0)return;let F=A.source,ee=f.get(F);if(ee){let Z=ee[v.__cacheKey];Z.usedTimes--,Z.usedTimes===0&&H(A),Object.keys(ee).length===0&&f.delete(F)}n.remove(A)}function H(A){let v=n.get(A);s.deleteTexture(v.__webglTexture);let F=A.source,ee=f.get(F);delete ee[v.__cacheKey],o.memory.textures--}function te(A){let v=n.get(A);v.__depthDisposeCallback&&v.__depthDisposeCallback();let F=A.depthTexture;if(F&&F.renderTarget===A&&V(F),A.isWebGLCubeRenderTarget)for(let Z=0;Z<6;Z++){if(Array.isArray(v.__webglFramebuffer[Z]))for(let se=0;se<v.__webglFramebuffer[Z].length;se++)s.deleteFramebuffer(v.__webglFramebuffer[Z][se]);else s.deleteFramebuffer(v.__webglFramebuffer[Z]);v.__webglDepthbuffer&&s.deleteRenderbuffer(v.__webglDepthbuffer[Z])}else{if(Array.isArray(v.__webglFramebuffer))for(let Z=0;Z<v.__webglFramebuffer.length;Z++)s.deleteFramebuffer(v.__webglFramebuffer[Z]);else s.deleteFramebuffer(v.__webglFramebuffer);if(v.__webglDepthbuffer&&s.deleteRenderbuffer(v.__webglDepthbuffer),v.__webglMultisampledFramebuffer&&s.deleteFramebuffer(v.__webglMultisampledFramebuffer),v.__webglColorRenderbuffer)for(let Z=0;Z<v.__webglColorRenderbuffer.length;Z++)v.__webglColorRenderbuffer[Z]&&s.deleteRenderbuffer(v.__webglColorRenderbuffer[Z]);v.__webglDepthRenderbuffer&&s.deleteRenderbuffer(v.__webglDepthRenderbuffer)}let ee=A.textures;for(let Z=0,se=ee.length;Z<se;Z++){let ce=n.get(ee[Z]);ce.__webglTexture&&(s.deleteTexture(ce.__webglTexture),o.memory.textures--),n.remove(ee[Z])}n.remove(A)}let X=0;function J(){X=0}function Q(){return X}function Te(A){X=A}function Be(){let A=X;return A>=i.maxTextures&&Ee("WebGLTextures: Trying to use "+(A+1)+" texture units while this GPU supports only "+i.maxTextures),X+=1,A}function K(A){let v=[];return v.push(A.wrapS),v.push(A.wrapT),v.push(A.wrapR||0),v.push(A.magFilter),v.push(A.minFilter),v.push(A.anisotropy),v.push(A.internalFormat),v.push(A.format),v.push(A.type),v.push(A.generateMipmaps),v.push(A.mipmapsAutoUpdate),v.push(A.premultiplyAlpha),v.push(A.flipY),v.push(A.unpackAlignment),v.push(A.colorSpace),v.join()}function me(A,v){let F=n.get(A);if(A.isVideoTexture&&Dt(A),A.isRenderTargetTexture===!1&&A.isExternalTexture!==!0&&A.version>0&&F.__version!==A.version){let ee=A.image;if(ee===null)Ee("WebGLRenderer: Texture marked for update but no image data found.");else if(ee.complete===!1)Ee("WebGLRenderer: Texture marked for update but image is incomplete");else{Lt(F,A,v);return}}else A.isExternalTexture&&(F.__webglTexture=A.sourceTexture?A.sourceTexture:null);t.bindTexture(s.TEXTURE_2D,F.__webglTexture,s.TEXTURE0+v)}function Me(A,v){let F=n.get(A);if(A.isRenderTargetTexture===!1&&A.version>0&&F.__version!==A.version){Lt(F,A,v);return}else A.isExternalTexture&&(F.__webglTexture=A.sourceTexture?A.sourceTexture:null);t.bindTexture(s.TEXTURE_2D_ARRAY,F.__webglTexture,s.TEXTURE0+v)}function Ie(A,v){let F=n.get(A);if(A.isRenderTargetTexture===!1&&A.version>0&&F.__version!==A.version){Lt(F,A,v);return}t.bindTexture(s.TEXTURE_3D,F.__webglTexture,s.TEXTURE0+v)}function ge(A,v){let F=n.get(A);if(A.version>0&&F.__version!==A.version){hn(F,A,v);return}t.bindTexture(s.TEXTURE_CUBE_MAP,F.__webglTexture,s.TEXTURE0+v)}let He={[zi]:s.REPEAT,[Cn]:s.CLAMP_TO_EDGE,[Hi]:s.MIRRORED_REPEAT},Rt={[gt]:s.NEAREST,[tl]:s.NEAREST_MIPMAP_NEAREST,[Ts]:s.NEAREST_MIPMAP_LINEAR,[St]:s.LINEAR,[br]:s.LINEAR_MIPMAP_NEAREST,[Ln]:s.LINEAR_MIPMAP_LINEAR},Ne={[fp]:s.NEVER,[gu]:s.ALWAYS,[pp]:s.LESS,[pu]:s.LEQUAL,[mp]:s.EQUAL,[mu]:s.GEQUAL,[gp]:s.GREATER,[xp]:s.NOTEQUAL};function st(A,v){if(v.type===_n&&e.has("OES_texture_float_linear")===!1&&(v.magFilter===St||v.magFilter===br||v.magFilter===Ts||v.magFilter===Ln||v.minFilter===St||v.minFilter===br||v.minFilter===Ts||v.minFilter===Ln)&&Ee("WebGLRenderer: Unable to use linear filtering with floating point textures. OES_texture_float_linear not supported on this device."),s.texParameteri(A,s.TEXTURE_WRAP_S,He[v.wrapS]),s.texParameteri(A,s.TEXTURE_WRAP_T,He[v.wrapT]),(A===s.TEXTURE_3D||A===s.TEXTURE_2D_ARRAY)&&s.texParameteri(A,s.TEXTURE_WRAP_R,He[v.wrapR]),s.texParameteri(A,s.TEXTURE_MAG_FILTER,Rt[v.magFilter]),s.texParameteri(A,s.TEXTURE_MIN_FILTER,Rt[v.minFilter]),v.compareFunction&&(s.texParameteri(A,s.TEXTURE_COMPARE_MODE,s.COMPARE_REF_TO_TEXTURE),s.texParameteri(A,s.TEXTURE_COMPARE_FUNC,Ne[v.compareFunction])),e.has("EXT_texture_filter_anisotropic")===!0){if(v.magFilter===gt||v.minFilter!==Ts&&v.minFilter!==Ln||v.type===_n&&e.has("OES_texture_float_linear")===!1)return;if(v.anisotropy>1||n.get(v).__currentAnisotropy){let F=e.get("EXT_texture_filter_anisotropic");s.texParameterf(A,F.TEXTURE_MAX_ANISOTROPY_EXT,Math.min(v.anisotropy,i.getMaxAnisotropy())),n.get(v).__currentAnisotropy=v.anisotropy}}}function ct(A,v){let F=!1;A.__webglInit===void 0&&(A.__webglInit=!0,v.addEventListener("dispose",N),O(v));let ee=v.source,Z=f.get(ee);Z===void 0&&(Z={},f.set(ee,Z));let se=K(v);if(se!==A.__cacheKey){Z[se]===void 0&&(Z[se]={texture:s.createTexture(),usedTimes:0},o.memory.textures++,F=!0),Z[se].usedTimes++;let ce=Z[A.__cacheKey];ce!==void 0&&(Z[A.__cacheKey].usedTimes--,ce.usedTimes===0&&H(v)),A.__cacheKey=se,A.__webglTexture=Z[se].texture}return F}function Ke(A,v,F){return Math.floor(Math.floor(A/F)/v)}function Xt(A,v,F,ee){let se=A.updateRanges;if(se.length===0)t.texSubImage2D(s.TEXTURE_2D,0,0,0,v.width,v.height,F,ee,v.data);else{se.sort((C,j)=>C.start-j.start);let ce=0;for(let C=1;C<se.length;C++){let j=se[ce],W=se[C],ae=j.start+j.count,ie=Ke(W.start,v.width,4),re=Ke(j.start,v.width,4);W.start<=ae+1&&ie===re&&Ke(W.start+W.count-1,v.width,4)===ie?j.count=Math.max(j.count,W.start+W.count-j.start):(++ce,se[ce]=W)}se.length=ce+1;let $=t.getParameter(s.UNPACK_ROW_LENGTH),Y=t.getParameter(s.UNPACK_SKIP_PIXELS),oe=t.getParameter(s.UNPACK_SKIP_ROWS);t.pixelStorei(s.UNPACK_ROW_LENGTH,v.width);for(let C=0,j=se.length;C<j;C++){let W=se[C],ae=Math.floor(W.start/4),ie=Math.ceil(W.count/4),re=ae%v.width,Re=Math.floor(ae/v.width),Ve=ie,ne=1;t.pixelStorei(s.UNPACK_SKIP_PIXELS,re),t.pixelStorei(s.UNPACK_SKIP_ROWS,Re),t.texSubImage2D(s.TEXTURE_2D,0,re,Re,Ve,ne,F,ee,v.data)}A.clearUpdateRanges(),t.pixelStorei(s.UNPACK_ROW_LENGTH,$),t.pixelStorei(s.UNPACK_SKIP_PIXELS,Y),t.pixelStorei(s.UNPACK_SKIP_ROWS,oe)}}function Lt(A,v,F){let ee=s.TEXTURE_2D;(v.isDataArrayTexture||v.isCompressedArrayTexture)&&(ee=s.TEXTURE_2D_ARRAY),v.isData3DTexture&&(ee=s.TEXTURE_3D);let Z=ct(A,v),se=v.source;t.bindTexture(ee,A.__webglTexture,s.TEXTURE0+F);let ce=n.get(se);if(se.version!==ce.__version||Z===!0){if(t.activeTexture(s.TEXTURE0+F),(typeof ImageBitmap<"u"&&v.image instanceof ImageBitmap)===!1){let ne=Xe.getPrimaries(Xe.workingColorSpace),Ce=v.colorSpace===Wn?null:Xe.getPrimaries(v.colorSpace),Ge=v.colorSpace===Wn||ne===Ce?s.NONE:s.BROWSER_DEFAULT_WEBGL;t.pixelStorei(s.UNPACK_FLIP_Y_WEBGL,v.flipY),t.pixelStorei(s.UNPACK_PREMULTIPLY_ALPHA_WEBGL,v.premultiplyAlpha),t.pixelStorei(s.UNPACK_COLORSPACE_CONVERSION_WEBGL,Ge)}t.pixelStorei(s.UNPACK_ALIGNMENT,v.unpackAlignment);let Y=b(v.image,!1,i.maxTextureSize);Y=Le(v,Y);let oe=r.convert(v.format,v.colorSpace),C=r.convert(v.type),j=T(v.internalFormat,oe,C,v.normalized,v.colorSpace,v.isVideoTexture);st(ee,v);let W,ae=v.mipmaps,ie=v.isVideoTexture!==!0,re=ce.__version===void 0||Z===!0,Re=se.dataReady,Ve=w(v,Y);if(v.isDepthTexture)j=x(v.format===Ei,v.type),re&&(ie?t.texStorage2D(s.TEXTURE_2D,1,j,Y.width,Y.height):t.texImage2D(s.TEXTURE_2D,0,j,Y.width,Y.height,0,oe,C,null));else if(v.isDataTexture)if(ae.length>0){ie&&re&&t.texStorage2D(s.TEXTURE_2D,Ve,j,ae[0].width,ae[0].height);for(let ne=0,Ce=ae.length;ne<Ce;ne++)W=ae[ne],ie?Re&&t.texSubImage2D(s.TEXTURE_2D,ne,0,0,W.width,W.height,oe,C,W.data):t.texImage2D(s.TEXTURE_2D,ne,j,W.width,W.height,0,oe,C,W.data);v.generateMipmaps=!1}else ie?(re&&t.texStorage2D(s.TEXTURE_2D,Ve,j,Y.width,Y.height),Re&&Xt(v,Y,oe,C)):t.texImage2D(s.TEXTURE_2D,0,j,Y.width,Y.height,0,oe,C,Y.data);else if(v.isCompressedTexture)if(v.isCompressedArrayTexture){ie&&re&&t.texStorage3D(s.TEXTURE_2D_ARRAY,Ve,j,ae[0].width,ae[0].height,Y.depth);for(let ne=0,Ce=ae.length;ne<Ce;ne++)if(W=ae[ne],v.format!==Dn)if(oe!==null)if(ie){if(Re)if(v.layerUpdates.size>0){let Ge=Au(W.width,W.height,v.format,v.type);for(let fe of v.layerUpdates){let rt=W.data.subarray(fe*Ge/W.data.BYTES_PER_ELEMENT,(fe+1)*Ge/W.data.BYTES_PER_ELEMENT);t.compressedTexSubImage3D(s.TEXTURE_2D_ARRAY,ne,0,0,fe,W.width,W.height,1,oe,rt)}}else t.compressedTexSubImage3D(s.TEXTURE_2D_ARRAY,ne,0,0,0,W.width,W.height,Y.depth,oe,W.data)}else t.compressedTexImage3D(s.TEXTURE_2D_ARRAY,ne,j,W.width,W.height,Y.depth,0,W.data,0,0);else Ee("WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()");else ie?Re&&t.texSubImage3D(s.TEXTURE_2D_ARRAY,ne,0,0,0,W.width,W.height,Y.depth,oe,C,W.data):t.texImage3D(s.TEXTURE_2D_ARRAY,ne,j,W.width,W.height,Y.depth,0,oe,C,W.data);v.layerUpdates.size>0&&v.clearLayerUpdates()}else{ie&&re&&t.texStorage2D(s.TEXTURE_2D,Ve,j,ae[0].width,ae[0].height);for(let ne=0,Ce=ae.length;ne<Ce;ne++)W=ae[ne],v.format!==Dn?oe!==null?ie?Re&&t.compressedTexSubImage2D(s.TEXTURE_2D,ne,0,0,W.width,W.height,oe,W.data):t.compressedTexImage2D(s.TEXTURE_2D,ne,j,W.width,W.height,0,W.data):Ee("WebGLRenderer: Attempt to load unsupported compressed texture format in .uploadTexture()"):ie?Re&&t.texSubImage2D(s.TEXTURE_2D,ne,0,0,W.width,W.height,oe,C,W.data):t.texImage2D(s.TEXTURE_2D,ne,j,W.width,W.height,0,oe,C,W.data)}else if(v.isDataArrayTexture)if(ie){if(re&&t.texStorage3D(s.TEXTURE_2D_ARRAY,Ve,j,Y.width,Y.height,Y.depth),Re)if(v.layerUpdates.size>0){let ne=Au(Y.width,Y.height,v.format,v.type);for(let Ce of v.layerUpdates){let Ge=Y.data.subarray(Ce*ne/Y.data.BYTES_PER_ELEMENT,(Ce+1)*ne/Y.data.BYTES_PER_ELEMENT);t.texSubImage3D(s.TEXTURE_2D_ARRAY,0,0,0,Ce,Y.width,Y.height,1,oe,C,Ge)}v.clearLayerUpdates()}else t.texSubImage3D(s.TEXTURE_2D_ARRAY,0,0,0,0,Y.width,Y.height,Y.depth,oe,C,Y.data)}else t.texImage3D(s.TEXTURE_2D_ARRAY,0,j,Y.width,Y.height,Y.depth,0,oe,C,Y.data);else if(v.isData3DTexture)ie?(re&&t.texStorage3D(s.TEXTURE_3D,Ve,j,Y.width,Y.height,Y.depth),Re&&t.texSubImage3D(s.TEXTURE_3D,0,0,0,0,Y.width,Y.height,Y.depth,oe,C,Y.data)):t.texImage3D(s.TEXTURE_3D,0,j,Y.width,Y.height,Y.depth,0,oe,C,Y.data);else if(v.isFramebufferTexture){if(re)if(ie)t.texStorage2D(s.TEXTURE_2D,Ve,j,Y.width,Y.height);else{let ne=Y.width,Ce=Y.height;for(let Ge=0;Ge<Ve;Ge++)t.texImage2D(s.TEXTURE_2D,Ge,j,ne,Ce,0,oe,C,null),ne>>=1,Ce>>=1}}else if(v.isHTMLTexture){if("texElementImage2D"in s){let ne=s.canvas;if(ne.hasAttribute("layoutsubtree")||ne.setAttribute("layoutsubtree","true"),Y.parentNode!==ne){ne.appendChild(Y),u.add(v),ne.onpaint=Ce=>{let Ge=Ce.changedElements;for(let fe of u)Ge.includes(fe.image)&&(fe.needsUpdate=!0)},ne.requestPaint();return}if(s.texElementImage2D.length===3)s.texElementImage2D(s.TEXTURE_2D,s.RGBA8,Y);else{let Ge=s.RGBA,fe=s.RGBA,rt=s.UNSIGNED_BYTE;s.texElementImage2D(s.TEXTURE_2D,0,Ge,fe,rt,Y)}s.texParameteri(s.TEXTURE_2D,s.TEXTURE_MIN_FILTER,s.LINEAR),s.texParameteri(s.TEXTURE_2D,s.TEXTURE_WRAP_S,s.CLAMP_TO_EDGE),s.texParameteri(s.TEXTURE_2D,s.TEXTURE_WRAP_T,s.CLAMP_TO_EDGE)}}else if(ae.length>0){if(ie&&re){let ne=ke(ae[0]);t.texStorage2D(s.TEXTURE_2D,Ve,j,ne.width,ne.height)}for(let ne=0,Ce=ae.length;ne<Ce;ne++)W=ae[ne],ie?Re&&t.texSubImage2D(s.TEXTURE_2D,ne,0,0,oe,C,W):t.texImage2D(s.TEXTURE_2D,ne,j,oe,C,W);v.generateMipmaps=!1}else if(ie){if(re){let ne=ke(Y);t.texStorage2D(s.TEXTURE_2D,Ve,j,ne.width,ne.height)}Re&&t.texSubImage2D(s.TEXTURE_2D,0,0,0,oe,C,Y)}else t.texImage2D(s.TEXTURE_2D,0,j,oe,C,Y);E(v)&&v.mipmapsAutoUpdate===!0&&M(ee),ce.__version=se.version,v.onUpdate&&v.onUpdate(v)}A.__version=v.version}function hn(A,v,F){if(v.image.length!==6)return;let ee=ct(A,v),Z=v.source;t.bindTexture(s.TEXTURE_CUBE_MAP,A.__webglTexture,s.TEXTURE0+F);let se=n.get(Z);if(Z.version!==se.__version||ee===!0){t.activeTexture(s.TEXTURE0+F);let ce=Xe.getPrimaries(Xe.workingColorSpace),$=v.colorSpace===Wn?null:Xe.getPrimaries(v.colorSpace),Y=v.colorSpace===Wn||ce===$?s.NONE:s.BROWSER_DEFAULT_WEBGL;t.pixelStorei(s.UNPACK_FLIP_Y_WEBGL,v.flipY),t.pixelStorei(s.UNPACK_PREMULTIPLY_ALPHA_WEBGL,v.premultiplyAlpha),t.pixelStorei(s.UNPACK_ALIGNMENT,v.unpackAlignment),t.pixelStorei(s.UNPACK_COLORSPACE_CONVERSION_WEBGL,Y);let oe=v.isCompressedTexture||v.image[0].isCompressedTexture,C=v.image[0]&&v.image[0].isDataTexture,j=[];for(let fe=0;fe<6;fe++)!oe&&!C?j[fe]=b(v.image[fe],!0,i.maxCubemapSize):j[fe]=C?v.image[fe].image:v.image[fe],j[fe]=Le(v,j[fe]);let W=j[0],ae=r.convert(v.format,v.colorSpace),ie=r.convert(v.type),re=T(v.internalFormat,ae,ie,v.normalized,v.colorSpace),Re=v.isVideoTexture!==!0,Ve=se.__version===void 0||ee===!0,ne=Z.dataReady,Ce=w(v,W);st(s.TEXTURE_CUBE_MAP,v);let Ge;if(v.isDepthTexture){if(re=x(v.format===Ei,v.type),Ve)if(Re)t.texStorage2D(s.TEXTURE_CUBE_MAP,1,re,W.width,W.height);else for(let fe=0;fe<6;fe++)t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,0,re,W.width,W.height,0,ae,ie,null)}else if(oe){Re&&Ve&&t.texStorage2D(s.TEXTURE_CUBE_MAP,Ce,re,W.width,W.height);for(let fe=0;fe<6;fe++){Ge=j[fe].mipmaps;for(let rt=0;rt<Ge.length;rt++){let zt=Ge[rt];v.format!==Dn?ae!==null?Re?ne&&t.compressedTexSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt,0,0,zt.width,zt.height,ae,zt.data):t.compressedTexImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt,re,zt.width,zt.height,0,zt.data):Ee("WebGLRenderer: Attempt to load unsupported compressed texture format in .setTextureCube()"):Re?ne&&t.texSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt,0,0,zt.width,zt.height,ae,ie,zt.data):t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt,re,zt.width,zt.height,0,ae,ie,zt.data)}}}else{if(Ge=v.mipmaps,Re&&Ve){Ge.length>0&&Ce++;let fe=ke(j[0]);t.texStorage2D(s.TEXTURE_CUBE_MAP,Ce,re,fe.width,fe.height)}for(let fe=0;fe<6;fe++)if(C){Re?ne&&t.texSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,0,0,0,j[fe].width,j[fe].height,ae,ie,j[fe].data):t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,0,re,j[fe].width,j[fe].height,0,ae,ie,j[fe].data);for(let rt=0;rt<Ge.length;rt++){let Li=Ge[rt].image[fe].image;Re?ne&&t.texSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt+1,0,0,Li.width,Li.height,ae,ie,Li.data):t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt+1,re,Li.width,Li.height,0,ae,ie,Li.data)}}else{Re?ne&&t.texSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,0,0,0,ae,ie,j[fe]):t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,0,re,ae,ie,j[fe]);for(let rt=0;rt<Ge.length;rt++){let zt=Ge[rt];Re?ne&&t.texSubImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt+1,0,0,ae,ie,zt.image[fe]):t.texImage2D(s.TEXTURE_CUBE_MAP_POSITIVE_X+fe,rt+1,re,ae,ie,zt.image[fe])}}}E(v)&&v.mipmapsAutoUpdate===!0&&M(s.TEXTURE_CUBE_MAP),se.__version=Z.version,v.onUpdate&&v.onUpdate(v)}A.__version=v.version}function xt(A,v,F,ee,Z,se){let ce=r.convert(F.format,F.colorSpace),$=r.convert(F.type),Y=T(F.internalFormat,ce,$,F.normalized,F.colorSpace),oe=n.get(v),C=n.get(F);if(C.__renderTarget=v,!oe.__hasExternalTextures){let j=Math.max(1,v.width>>se),W=Math.max(1,v.height>>se);Z===s.TEXTURE_3D||Z===s.TEXTURE_2D_ARRAY?t.texImage3D(Z,se,Y,j,W,v.depth,0,ce,$,null):t.texImage2D(Z,se,Y,j,W,0,ce,$,null)}t.bindFramebuffer(s.FRAMEBUFFER,A),de(v)?a.framebufferTexture2DMultisampleEXT(s.FRAMEBUFFER,ee,Z,C.__webglTexture,0,mt(v)):(Z===s.TEXTURE_2D||Z>=s.TEXTURE_CUBE_MAP_POSITIVE_X&&Z<=s.TEXTURE_CUBE_MAP_NEGATIVE_Z)&&s.framebufferTexture2D(s.FRAMEBUFFER,ee,Z,C.__webglTexture,se),t.bindFramebuffer(s.FRAMEBUFFER,null)}function qn(A,v,F){if(s.bindRenderbuffer(s.RENDERBUFFER,A),v.depthBuffer){let ee=v.depthTexture,Z=ee&&ee.isDepthTexture?ee.type:null,se=x(v.stencilBuffer,Z),ce=v.stencilBuffer?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT;de(v)?a.renderbufferStorageMultisampleEXT(s.RENDERBUFFER,mt(v),se,v.width,v.height):F?s.renderbufferStorageMultisample(s.RENDERBUFFER,mt(v),se,v.width,v.height):s.renderbufferStorage(s.RENDERBUFFER,se,v.width,v.height),s.framebufferRenderbuffer(s.FRAMEBUFFER,ce,s.RENDERBUFFER,A)}else{let ee=v.textures;for(let Z=0;Z<ee.length;Z++){let se=ee[Z],ce=r.convert(se.format,se.colorSpace),$=r.convert(se.type),Y=T(se.internalFormat,ce,$,se.normalized,se.colorSpace);de(v)?a.renderbufferStorageMultisampleEXT(s.RENDERBUFFER,mt(v),Y,v.width,v.height):F?s.renderbufferStorageMultisample(s.RENDERBUFFER,mt(v),Y,v.width,v.height):s.renderbufferStorage(s.RENDERBUFFER,Y,v.width,v.height)}}s.bindRenderbuffer(s.RENDERBUFFER,null)}function Bt(A,v,F){let ee=v.isWebGLCubeRenderTarget===!0;if(t.bindFramebuffer(s.FRAMEBUFFER,A),!(v.depthTexture&&v.depthTexture.isDepthTexture))throw new Error("THREE.WebGLTextures: renderTarget.depthTexture must be an instance of THREE.DepthTexture.");let Z=n.get(v.depthTexture);Z.__renderTarget=v;let se=ee?v.depthTexture.image[0]:v.depthTexture.image;(!Z.__webglTexture||se.width!==v.width||se.height!==v.height)&&(se.width=v.width,se.height=v.height,v.depthTexture.needsUpdate=!0),ee?ge(v.depthTexture,0):me(v.depthTexture,0);let ce=Z.__webglTexture,$=mt(v),Y=ee?s.TEXTURE_CUBE_MAP_POSITIVE_X+F:s.TEXTURE_2D,oe=v.depthTexture.format===Ei?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT;if(v.depthTexture.format===xi)de(v)?a.framebufferTexture2DMultisampleEXT(s.FRAMEBUFFER,oe,Y,ce,0,$):s.framebufferTexture2D(s.FRAMEBUFFER,oe,Y,ce,0);else if(v.depthTexture.format===Ei)de(v)?a.framebufferTexture2DMultisampleEXT(s.FRAMEBUFFER,oe,Y,ce,0,$):s.framebufferTexture2D(s.FRAMEBUFFER,oe,Y,ce,0);else throw new Error("THREE.WebGLTextures: Unknown depthTexture format.")}function Sn(A){let v=n.get(A),F=A.isWebGLCubeRenderTarget===!0;if(v.__boundDepthTexture!==A.depthTexture){let ee=A.depthTexture;if(v.__depthDisposeCallback&&v.__depthDisposeCallback(),ee){let Z=()=>{delete v.__boundDepthTexture,delete v.__depthDisposeCallback,ee.removeEventListener("dispose",Z)};ee.addEventListener("dispose",Z),v.__depthDisposeCallback=Z}v.__boundDepthTexture=ee}if(A.depthTexture&&!v.__autoAllocateDepthBuffer)if(F)for(let ee=0;ee<6;ee++)Bt(v.__webglFramebuffer[ee],A,ee);else A.texture.mipmaps.length>0?Bt(v.__webglFramebuffer[0],A,0):Bt(v.__webglFramebuffer,A,0);else if(F){v.__webglDepthbuffer=[];for(let ee=0;ee<6;ee++)if(t.bindFramebuffer(s.FRAMEBUFFER,v.__webglFramebuffer[ee]),v.__webglDepthbuffer[ee]===void 0)v.__webglDepthbuffer[ee]=s.createRenderbuffer(),qn(v.__webglDepthbuffer[ee],A,!1);else{let Z=A.stencilBuffer?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT,se=v.__webglDepthbuffer[ee];s.bindRenderbuffer(s.RENDERBUFFER,se),s.framebufferRenderbuffer(s.FRAMEBUFFER,Z,s.RENDERBUFFER,se)}}else if(A.texture.mipmaps.length>0?t.bindFramebuffer(s.FRAMEBUFFER,v.__webglFramebuffer[0]):t.bindFramebuffer(s.FRAMEBUFFER,v.__webglFramebuffer),v.__webglDepthbuffer===void 0)v.__webglDepthbuffer=s.createRenderbuffer(),qn(v.__webglDepthbuffer,A,!1);else{let Z=A.stencilBuffer?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT,se=v.__webglDepthbuffer;s.bindRenderbuffer(s.RENDERBUFFER,se),s.framebufferRenderbuffer(s.FRAMEBUFFER,Z,s.RENDERBUFFER,se)}t.bindFramebuffer(s.FRAMEBUFFER,null)}function Tn(A,v,F){let ee=n.get(A);v!==void 0&&xt(ee.__webglFramebuffer,A,A.texture,s.COLOR_ATTACHMENT0,s.TEXTURE_2D,0),F!==void 0&&Sn(A)}function An(A){let v=A.texture,F=n.get(A),ee=n.get(v);A.addEventListener("dispose",k),O(A);let Z=A.textures,se=A.isWebGLCubeRenderTarget===!0,ce=Z.length>1;if(ce||(ee.__webglTexture===void 0&&(ee.__webglTexture=s.createTexture()),ee.__version=v.version,o.memory.textures++),se){F.__webglFramebuffer=[];for(let $=0;$<6;$++)if(v.mipmaps.length>0){F.__webglFramebuffer[$]=[];for(let Y=0;Y<v.mipmaps.length;Y++)F.__webglFramebuffer[$][Y]=s.createFramebuffer()}else F.__webglFramebuffer[$]=s.createFramebuffer()}else{if(v.mipmaps.length>0){F.__webglFramebuffer=[];for(let $=0;$<v.mipmaps.length;$++)F.__webglFramebuffer[$]=s.createFramebuffer()}else F.__webglFramebuffer=s.createFramebuffer();if(ce)for(let $=0,Y=Z.length;$<Y;$++){let oe=n.get(Z[$]);oe.__webglTexture===void 0&&(oe.__webglTexture=s.createTexture(),o.memory.textures++)}if(A.samples>0&&de(A)===!1){F.__webglMultisampledFramebuffer=s.createFramebuffer(),F.__webglColorRenderbuffer=[],t.bindFramebuffer(s.FRAMEBUFFER,F.__webglMultisampledFramebuffer);for(let $=0;$<Z.length;$++){let Y=Z[$];F.__webglColorRenderbuffer[$]=s.createRenderbuffer(),s.bindRenderbuffer(s.RENDERBUFFER,F.__webglColorRenderbuffer[$]);let oe=r.convert(Y.format,Y.colorSpace),C=r.convert(Y.type),j=T(Y.internalFormat,oe,C,Y.normalized,Y.colorSpace,A.isXRRenderTarget===!0),W=mt(A);s.renderbufferStorageMultisample(s.RENDERBUFFER,W,j,A.width,A.height),s.framebufferRenderbuffer(s.FRAMEBUFFER,s.COLOR_ATTACHMENT0+$,s.RENDERBUFFER,F.__webglColorRenderbuffer[$])}s.bindRenderbuffer(s.RENDERBUFFER,null),A.depthBuffer&&(F.__webglDepthRenderbuffer=s.createRenderbuffer(),qn(F.__webglDepthRenderbuffer,A,!0)),t.bindFramebuffer(s.FRAMEBUFFER,null)}}if(se){t.bindTexture(s.TEXTURE_CUBE_MAP,ee.__webglTexture),st(s.TEXTURE_CUBE_MAP,v);for(let $=0;$<6;$++)if(v.mipmaps.length>0)for(let Y=0;Y<v.mipmaps.length;Y++)xt(F.__webglFramebuffer[$][Y],A,v,s.COLOR_ATTACHMENT0,s.TEXTURE_CUBE_MAP_POSITIVE_X+$,Y);else xt(F.__webglFramebuffer[$],A,v,s.COLOR_ATTACHMENT0,s.TEXTURE_CUBE_MAP_POSITIVE_X+$,0);E(v)?M(s.TEXTURE_CUBE_MAP):v.mipmaps.length>0&&s.texParameteri(s.TEXTURE_CUBE_MAP,s.TEXTURE_MAX_LEVEL,v.mipmaps.length-1),t.unbindTexture()}else if(ce){for(let $=0,Y=Z.length;$<Y;$++){let oe=Z[$],C=n.get(oe),j=s.TEXTURE_2D;(A.isWebGL3DRenderTarget||A.isWebGLArrayRenderTarget)&&(j=A.isWebGL3DRenderTarget?s.TEXTURE_3D:s.TEXTURE_2D_ARRAY),t.bindTexture(j,C.__webglTexture),st(j,oe),xt(F.__webglFramebuffer,A,oe,s.COLOR_ATTACHMENT0+$,j,0),E(oe)&&M(j)}t.unbindTexture()}else{let $=s.TEXTURE_2D;if((A.isWebGL3DRenderTarget||A.isWebGLArrayRenderTarget)&&($=A.isWebGL3DRenderTarget?s.TEXTURE_3D:s.TEXTURE_2D_ARRAY),t.bindTexture($,ee.__webglTexture),st($,v),v.mipmaps.length>0)for(let Y=0;Y<v.mipmaps.length;Y++)xt(F.__webglFramebuffer[Y],A,v,s.COLOR_ATTACHMENT0,$,Y);else xt(F.__webglFramebuffer,A,v,s.COLOR_ATTACHMENT0,$,0);E(v)?M($):v.mipmaps.length>0&&s.texParameteri($,s.TEXTURE_MAX_LEVEL,v.mipmaps.length-1),t.unbindTexture()}A.depthBuffer&&Sn(A)}function D(A){let v=A.textures;for(let F=0,ee=v.length;F<ee;F++){let Z=v[F];if(E(Z)&&Z.mipmapsAutoUpdate===!0){let se=R(A),ce=n.get(Z).__webglTexture;t.bindTexture(se,ce),M(se),t.unbindTexture()}}}let En=[];function pt(A){if(A.samples>0){if(de(A)===!1){let v=A.textures,F=A.width,ee=A.height,Z=s.COLOR_BUFFER_BIT,se=A.stencilBuffer?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT,ce=n.get(A),$=v.length>1;if($)for(let oe=0;oe<v.length;oe++)t.bindFramebuffer(s.FRAMEBUFFER,ce.__webglMultisampledFramebuffer),s.framebufferRenderbuffer(s.FRAMEBUFFER,s.COLOR_ATTACHMENT0+oe,s.RENDERBUFFER,null),t.bindFramebuffer(s.FRAMEBUFFER,ce.__webglFramebuffer),s.framebufferTexture2D(s.DRAW_FRAMEBUFFER,s.COLOR_ATTACHMENT0+oe,s.TEXTURE_2D,null,0);t.bindFramebuffer(s.READ_FRAMEBUFFER,ce.__webglMultisampledFramebuffer),A.texture.mipmaps.length>0?t.bindFramebuffer(s.DRAW_FRAMEBUFFER,ce.__webglFramebuffer[0]):t.bindFramebuffer(s.DRAW_FRAMEBUFFER,ce.__webglFramebuffer);for(let oe=0;oe<v.length;oe++){if(A.resolveDepthBuffer&&(A.depthBuffer&&(Z|=s.DEPTH_BUFFER_BIT),A.stencilBuffer&&A.resolveStencilBuffer&&(Z|=s.STENCIL_BUFFER_BIT)),$){s.framebufferRenderbuffer(s.READ_FRAMEBUFFER,s.COLOR_ATTACHMENT0,s.RENDERBUFFER,ce.__webglColorRenderbuffer[oe]);let C=n.get(v[oe]).__webglTexture;s.framebufferTexture2D(s.DRAW_FRAMEBUFFER,s.COLOR_ATTACHMENT0,s.TEXTURE_2D,C,0)}s.blitFramebuffer(0,0,F,ee,0,0,F,ee,Z,s.NEAREST),l===!0&&(En.length=0,En.push(s.COLOR_ATTACHMENT0+oe),A.depthBuffer&&A.storeMultisampledDepthBuffer===!1&&En.push(se),s.invalidateFramebuffer(s.READ_FRAMEBUFFER,En))}if(t.bindFramebuffer(s.READ_FRAMEBUFFER,null),t.bindFramebuffer(s.DRAW_FRAMEBUFFER,null),$)for(let oe=0;oe<v.length;oe++){t.bindFramebuffer(s.FRAMEBUFFER,ce.__webglMultisampledFramebuffer),s.framebufferRenderbuffer(s.FRAMEBUFFER,s.COLOR_ATTACHMENT0+oe,s.RENDERBUFFER,ce.__webglColorRenderbuffer[oe]);let C=n.get(v[oe]).__webglTexture;t.bindFramebuffer(s.FRAMEBUFFER,ce.__webglFramebuffer),s.framebufferTexture2D(s.DRAW_FRAMEBUFFER,s.COLOR_ATTACHMENT0+oe,s.TEXTURE_2D,C,0)}t.bindFramebuffer(s.DRAW_FRAMEBUFFER,ce.__webglMultisampledFramebuffer)}else if(A.depthBuffer&&A.storeMultisampledDepthBuffer===!1&&l){let v=A.stencilBuffer?s.DEPTH_STENCIL_ATTACHMENT:s.DEPTH_ATTACHMENT;s.invalidateFramebuffer(s.DRAW_FRAMEBUFFER,[v])}}}function mt(A){return Math.min(i.maxSamples,A.samples)}function de(A){let v=n.get(A);return A.samples>0&&e.has("WEBGL_multisampled_render_to_texture")===!0&&v.__useRenderToTexture!==!1}function Dt(A){let v=o.render.frame;h.get(A)!==v&&(h.set(A,v),A.update())}function Le(A,v){let F=A.colorSpace,ee=A.format,Z=A.type;return A.isCompressedTexture===!0||A.isVideoTexture===!0||F!==an&&F!==Wn&&(Xe.getTransfer(F)===nt?(ee!==Dn||Z!==pn)&&Ee("WebGLTextures: sRGB encoded textures have to use RGBAFormat and UnsignedByteType."):Oe("WebGLTextures: Unsupported texture color space:",F)),v}function ke(A){return typeof HTMLImageElement<"u"&&A instanceof HTMLImageElement?(c.width=A.naturalWidth||A.width,c.height=A.naturalHeight||A.height):typeof VideoFrame<"u"&&A instanceof VideoFrame?(c.width=A.displayWidth,c.height=A.displayHeight):(c.width=A.width,c.height=A.height),c}this.allocateTextureUnit=Be,this.resetTextureUnits=J,this.getTextureUnits=Q,this.setTextureUnits=Te,this.setTexture2D=me,this.setTexture2DArray=Me,this.setTexture3D=Ie,this.setTextureCube=ge,this.rebindTextures=Tn,this.setupRenderTarget=An,this.updateRenderTargetMipmap=D,this.updateMultisampleRenderTarget=pt,this.setupDepthRenderbuffer=Sn,this.setupFrameBufferTexture=xt,this.useMultisampledRTT=de,this.dispose=G}function Hb(s,e){function t(n,i=Wn){let r,o=Xe.getTransfer(i);if(n===pn)return s.UNSIGNED_BYTE;if(n===il)return s.UNSIGNED_SHORT_4_4_4_4;if(n===sl)return s.UNSIGNED_SHORT_5_5_5_1;if(n===cu)return s.UNSIGNED_INT_5_9_9_9_REV;if(n===hu)return s.UNSIGNED_INT_10F_11F_11F_REV;if(n===au)return s.BYTE;if(n===lu)return s.SHORT;if(n===Mr)return s.UNSIGNED_SHORT;if(n===nl)return s.INT;if(n===Vn)return s.UNSIGNED_INT;if(n===_n)return s.FLOAT;if(n===bn)return s.HALF_FLOAT;if(n===uu)return s.ALPHA;if(n===du)return s.RGB;if(n===Dn)return s.RGBA;if(n===xi)return s.DEPTH_COMPONENT;if(n===Ei)return s.DEPTH_STENCIL;if(n===rl)return s.RED;if(n===ol)return s.RED_INTEGER;if(n===Ji)return s.RG;if(n===al)return s.RG_INTEGER;if(n===ll)return s.RGBA_INTEGER;if(n===Mo||n===wo||n===So||n===To)if(o===nt)if(r=e.get("WEBGL_compressed_texture_s3tc_srgb"),r!==null){if(n===Mo)return r.COMPRESSED_SRGB_S3TC_DXT1_EXT;if(n===wo)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT1_EXT;if(n===So)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT3_EXT;if(n===To)return r.COMPRESSED_SRGB_ALPHA_S3TC_DXT5_EXT}else return null;else if(r=e.get("WEBGL_compressed_texture_s3tc"),r!==null){if(n===Mo)return r.COMPRESSED_RGB_S3TC_DXT1_EXT;if(n===wo)return r.COMPRESSED_RGBA_S3TC_DXT1_EXT;if(n===So)return r.COMPRESSED_RGBA_S3TC_DXT3_EXT;if(n===To)return r.COMPRESSED_RGBA_S3TC_DXT5_EXT}else return null;if(n===cl||n===hl||n===ul||n===dl)if(r=e.get("WEBGL_compressed_texture_pvrtc"),r!==null){if(n===cl)return r.COMPRESSED_RGB_PVRTC_4BPPV1_IMG;if(n===hl)return r.COMPRESSED_RGB_PVRTC_2BPPV1_IMG;if(n===ul)return r.COMPRESSED_RGBA_PVRTC_4BPPV1_IMG;if(n===dl)return r.COMPRESSED_RGBA_PVRTC_2BPPV1_IMG}else return null;if(n===fl||n===pl||n===ml||n===gl||n===xl||n===Ao||n===yl)if(r=e.get("WEBGL_compressed_texture_etc"),r!==null){if(n===fl||n===pl)return o===nt?r.COMPRESSED_SRGB8_ETC2:r.COMPRESSED_RGB8_ETC2;if(n===ml)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ETC2_EAC:r.COMPRESSED_RGBA8_ETC2_EAC;if(n===gl)return r.COMPRESSED_R11_EAC;if(n===xl)return r.COMPRESSED_SIGNED_R11_EAC;if(n===Ao)return r.COMPRESSED_RG11_EAC;if(n===yl)return r.COMPRESSED_SIGNED_RG11_EAC}else return null;if(n===vl||n===_l||n===bl||n===Ml||n===wl||n===Sl||n===Tl||n===Al||n===El||n===Rl||n===Cl||n===Pl||n===Il||n===Ll)if(r=e.get("WEBGL_compressed_texture_astc"),r!==null){if(n===vl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_4x4_KHR:r.COMPRESSED_RGBA_ASTC_4x4_KHR;if(n===_l)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_5x4_KHR:r.COMPRESSED_RGBA_ASTC_5x4_KHR;if(n===bl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_5x5_KHR:r.COMPRESSED_RGBA_ASTC_5x5_KHR;if(n===Ml)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_6x5_KHR:r.COMPRESSED_RGBA_ASTC_6x5_KHR;if(n===wl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_6x6_KHR:r.COMPRESSED_RGBA_ASTC_6x6_KHR;if(n===Sl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x5_KHR:r.COMPRESSED_RGBA_ASTC_8x5_KHR;if(n===Tl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x6_KHR:r.COMPRESSED_RGBA_ASTC_8x6_KHR;if(n===Al)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_8x8_KHR:r.COMPRESSED_RGBA_ASTC_8x8_KHR;if(n===El)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x5_KHR:r.COMPRESSED_RGBA_ASTC_10x5_KHR;if(n===Rl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x6_KHR:r.COMPRESSED_RGBA_ASTC_10x6_KHR;if(n===Cl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x8_KHR:r.COMPRESSED_RGBA_ASTC_10x8_KHR;if(n===Pl)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_10x10_KHR:r.COMPRESSED_RGBA_ASTC_10x10_KHR;if(n===Il)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_12x10_KHR:r.COMPRESSED_RGBA_ASTC_12x10_KHR;if(n===Ll)return o===nt?r.COMPRESSED_SRGB8_ALPHA8_ASTC_12x12_KHR:r.COMPRESSED_RGBA_ASTC_12x12_KHR}else return null;if(n===Dl||n===Nl||n===Ol)if(r=e.get("EXT_texture_compression_bptc"),r!==null){if(n===Dl)return o===nt?r.COMPRESSED_SRGB_ALPHA_BPTC_UNORM_EXT:r.COMPRESSED_RGBA_BPTC_UNORM_EXT;if(n===Nl)return r.COMPRESSED_RGB_BPTC_SIGNED_FLOAT_EXT;if(n===Ol)return r.COMPRESSED_RGB_BPTC_UNSIGNED_FLOAT_EXT}else return null;if(n===Ul||n===Fl||n===Eo||n===kl)if(r=e.get("EXT_texture_compression_rgtc"),r!==null){if(n===Ul)return r.COMPRESSED_RED_RGTC1_EXT;if(n===Fl)return r.COMPRESSED_SIGNED_RED_RGTC1_EXT;if(n===Eo)return r.COMPRESSED_RED_GREEN_RGTC2_EXT;if(n===kl)return r.COMPRESSED_SIGNED_RED_GREEN_RGTC2_EXT}else return null;return n===As?s.UNSIGNED_INT_24_8:s[n]!==void 0?s[n]:null}return{convert:t}}var Gb=`
void main() {

	gl_Position = vec4( position, 1.0 );

}`,Vb=`
uniform sampler2DArray depthColor;
uniform float depthWidth;
uniform float depthHeight;

void main() {

	vec2 coord = vec2( gl_FragCoord.x / depthWidth, gl_FragCoord.y / depthHeight );

	if ( coord.x >= 1.0 ) {

		gl_FragDepth = texture( depthColor, vec3( coord.x - 1.0, coord.y, 1 ) ).r;

	} else {

		gl_FragDepth = texture( depthColor, vec3( coord.x, coord.y, 0 ) ).r;

	}

}`,Ou=class{constructor(){this.texture=null,this.mesh=null,this.depthNear=0,this.depthFar=0}init(e,t){if(this.texture===null){let n=new ao(e.texture);(e.depthNear!==t.depthNear||e.depthFar!==t.depthFar)&&(this.depthNear=e.depthNear,this.depthFar=e.depthFar),this.texture=n}}getMesh(e){if(this.texture!==null&&this.mesh===null){let t=e.cameras[0].viewport,n=new dn({vertexShader:Gb,fragmentShader:Vb,uniforms:{depthColor:{value:this.texture},depthWidth:{value:t.z},depthHeight:{value:t.w}}});this.mesh=new ue(new Vt(20,20),n)}return this.mesh}reset(){this.texture=null,this.mesh=null}getDepthTexture(){return this.texture}},Uu=class extends Bn{constructor(e,t){super();let n=this,i=null,r=1,o=null,a="local-floor",l=1,c=null,h=null,u=null,d=null,f=null,g=null,y=typeof XRWebGLBinding<"u",p=new Ou,m={},b=t.getContextAttributes(),E=null,M=null,R=[],T=[],x=new ye,w=null,O=null,I=new dt;I.viewport=new at;let N=new dt;N.viewport=new at;let k=[I,N],V=new Za,P=null,G=null;this.cameraAutoUpdate=!0,this.enabled=!1,this.isPresenting=!1,this.getController=function(K){let me=R[K];return me===void 0&&(me=new cr,R[K]=me),me.getTargetRaySpace()},this.getControllerGrip=function(K){let me=R[K];return me===void 0&&(me=new cr,R[K]=me),me.getGripSpace()},this.getHand=function(K){let me=R[K];return me===void 0&&(me=new cr,R[K]=me),me.getHandSpace()};function q(K){let me=T.indexOf(K.inputSource);if(me===-1)return;let Me=R[me];Me!==void 0&&(Me.update(K.inputSource,K.frame,c||o),Me.dispatchEvent({type:K.type,data:K.inputSource}))}function H(){i.removeEventListener("select",q),i.removeEventListener("selectstart",q),i.removeEventListener("selectend",q),i.removeEventListener("squeeze",q),i.removeEventListener("squeezestart",q),i.removeEventListener("squeezeend",q),i.removeEventListener("end",H),i.removeEventListener("inputsourceschange",te);for(let K=0;K<R.length;K++){let me=T[K];me!==null&&(T[K]=null,R[K].disconnect(me))}P=null,G=null,p.reset();for(let K in m)delete m[K];if(e.setRenderTarget(E),f=null,d=null,u=null,i=null,M=null,Be.stop(),n.isPresenting=!1,e.setPixelRatio(w),e.setSize(x.width,x.height,!1),O!==null){let K=O.camera;K.fov=O.fov,K.zoom=O.zoom,K.updateProjectionMatrix(),O=null}n.dispatchEvent({type:"sessionend"})}this.setFramebufferScaleFactor=function(K){r=K,n.isPresenting===!0&&Ee("WebXRManager: Cannot change framebuffer scale while presenting.")},this.setReferenceSpaceType=function(K){a=K,n.isPresenting===!0&&Ee("WebXRManager: Cannot change reference space type while presenting.")},this.getReferenceSpace=function(){return c||o},this.setReferenceSpace=function(K){c=K},this.getBaseLayer=function(){return d!==null?d:f},this.getBinding=function(){return u===null&&y&&(u=new XRWebGLBinding(i,t)),u},this.getFrame=function(){return g},this.getSession=function(){return i},this.setSession=async function(K){if(i=K,i!==null){if(E=e.getRenderTarget(),i.addEventListener("select",q),i.addEventListener("selectstart",q),i.addEventListener("selectend",q),i.addEventListener("squeeze",q),i.addEventListener("squeezestart",q),i.addEventListener("squeezeend",q),i.addEventListener("end",H),i.addEventListener("inputsourceschange",te),b.xrCompatible!==!0&&await t.makeXRCompatible(),w=e.getPixelRatio(),e.getSize(x),y&&"createProjectionLayer"in XRWebGLBinding.prototype){let Me=null,Ie=null,ge=null;b.depth&&(ge=b.stencil?t.DEPTH24_STENCIL8:t.DEPTH_COMPONENT24,Me=b.stencil?Ei:xi,Ie=b.stencil?As:Vn);let He={colorFormat:t.RGBA8,depthFormat:ge,scaleFactor:r};u=this.getBinding(),d=u.createProjectionLayer(He),i.updateRenderState({layers:[d]}),e.setPixelRatio(1),e.setSize(d.textureWidth,d.textureHeight,!1),M=new Tt(d.textureWidth,d.textureHeight,{format:Dn,type:pn,depthTexture:new zn(d.textureWidth,d.textureHeight,Ie,void 0,void 0,void 0,void 0,void 0,void 0,Me),stencilBuffer:b.stencil,colorSpace:e.outputColorSpace,samples:b.antialias?4:0,resolveDepthBuffer:d.ignoreDepthValues===!1,resolveStencilBuffer:d.ignoreDepthValues===!1,storeMultisampledDepthBuffer:d.ignoreDepthValues===!1,storeMultisampledStencilBuffer:d.ignoreDepthValues===!1})}else{let Me={antialias:b.antialias,alpha:!0,depth:b.depth,stencil:b.stencil,framebufferScaleFactor:r};f=new XRWebGLLayer(i,t,Me),i.updateRenderState({baseLayer:f}),e.setPixelRatio(1),e.setSize(f.framebufferWidth,f.framebufferHeight,!1),M=new Tt(f.framebufferWidth,f.framebufferHeight,{format:Dn,type:pn,colorSpace:e.outputColorSpace,stencilBuffer:b.stencil,resolveDepthBuffer:f.ignoreDepthValues===!1,resolveStencilBuffer:f.ignoreDepthValues===!1,storeMultisampledDepthBuffer:f.ignoreDepthValues===!1,storeMultisampledStencilBuffer:f.ignoreDepthValues===!1})}M.isXRRenderTarget=!0,this.setFoveation(l),c=null,o=await i.requestReferenceSpace(a),Be.setContext(i),Be.start(),n.isPresenting=!0,n.dispatchEvent({type:"sessionstart"})}},this.getEnvironmentBlendMode=function(){if(i!==null)return i.environmentBlendMode},this.getDepthTexture=function(){return p.getDepthTexture()};function te(K){for(let me=0;me<K.removed.length;me++){let Me=K.removed[me],Ie=T.indexOf(Me);Ie>=0&&(T[Ie]=null,R[Ie].disconnect(Me))}for(let me=0;me<K.added.length;me++){let Me=K.added[me],Ie=T.indexOf(Me);if(Ie===-1){for(let He=0;He<R.length;He++)if(He>=T.length){T.push(Me),Ie=He;break}else if(T[He]===null){T[He]=Me,Ie=He;break}if(Ie===-1)break}let ge=R[Ie];ge&&ge.connect(Me)}}function X(K,me){me===null?K.matrixWorld.copy(K.matrix):K.matrixWorld.multiplyMatrices(me.matrixWorld,K.matrix),K.matrixWorldInverse.copy(K.matrixWorld).invert()}this.updateCamera=function(K){if(i===null)return;let me=K.near,Me=K.far;p.texture!==null&&(p.depthNear>0&&(me=p.depthNear),p.depthFar>0&&(Me=p.depthFar)),V.near=N.near=I.near=me,V.far=N.far=I.far=Me,(P!==V.near||G!==V.far)&&(i.updateRenderState({depthNear:V.near,depthFar:V.far}),P=V.near,G=V.far),V.layers.mask=K.layers.mask|6,I.layers.mask=V.layers.mask&-5,N.layers.mask=V.layers.mask&-3;let Ie=K.parent,ge=V.cameras;X(V,Ie);for(let He=0;He<ge.length;He++)X(ge[He],Ie);V.projectionMatrix.copy(I.projectionMatrix),V.projectionMatrixInverse.copy(I.projectionMatrixInverse),O===null&&K.isPerspectiveCamera&&(O={camera:K,fov:K.fov,zoom:K.zoom}),J(K,V,Ie)};function J(K,me,Me){Me===null?K.matrix.copy(me.matrixWorld):(K.matrix.copy(Me.matrixWorld),K.matrix.invert(),K.matrix.multiply(me.matrixWorld)),K.matrix.decompose(K.position,K.quaternion,K.scale),K.updateMatrixWorld(!0),K.projectionMatrix.copy(me.projectionMatrix),K.projectionMatrixInverse.copy(me.projectionMatrixInverse),K.isPerspectiveCamera&&(K.fov=fs*2*Math.atan(1/K.projectionMatrix.elements[5]),K.zoom=1)}this.getCamera=function(){return V},this.getFoveation=function(){if(!(d===null&&f===null))return l},this.setFoveation=function(K){l=K,d!==null&&(d.fixedFoveation=K),f!==null&&f.fixedFoveation!==void 0&&(f.fixedFoveation=K)},this.hasDepthSensing=function(){return p.texture!==null},this.getDepthSensingMesh=function(){return p.getMesh(V)},this.getCameraTexture=function(K){return m[K]};let Q=null;function Te(K,me){if(h=me.getViewerPose(c||o),g=me,h!==null){let Me=h.views;f!==null&&(e.setRenderTargetFramebuffer(M,f.framebuffer),e.setRenderTarget(M));let Ie=!1;Me.length!==V.cameras.length&&(V.cameras.length=0,Ie=!0);for(let Ne=0;Ne<Me.length;Ne++){let st=Me[Ne],ct=null;if(f!==null)ct=f.getViewport(st);else{let Xt=u.getViewSubImage(d,st);ct=Xt.viewport,Ne===0&&(e.setRenderTargetTextures(M,Xt.colorTexture,Xt.depthStencilTexture),e.setRenderTarget(M))}let Ke=k[Ne];Ke===void 0&&(Ke=new dt,Ke.layers.enable(Ne),Ke.viewport=new at,k[Ne]=Ke),Ke.matrix.fromArray(st.transform.matrix),Ke.matrix.decompose(Ke.position,Ke.quaternion,Ke.scale),Ke.projectionMatrix.fromArray(st.projectionMatrix),Ke.projectionMatrixInverse.copy(Ke.projectionMatrix).invert(),Ke.viewport.set(ct.x,ct.y,ct.width,ct.height),Ne===0&&(V.matrix.copy(Ke.matrix),V.matrix.decompose(V.position,V.quaternion,V.scale)),Ie===!0&&V.cameras.push(Ke)}let ge=i.enabledFeatures;if(ge&&ge.includes("depth-sensing")&&i.depthUsage=="gpu-optimized"&&y){u=n.getBinding();let Ne=u.getDepthInformation(Me[0]);Ne&&Ne.isValid&&Ne.texture&&p.init(Ne,i.renderState)}if(ge&&ge.includes("camera-access")&&y){e.state.unbindTexture(),u=n.getBinding();for(let Ne=0;Ne<Me.length;Ne++){let st=Me[Ne].camera;if(st){let ct=m[st];ct||(ct=new ao,m[st]=ct);let Ke=u.getCameraImage(st);ct.sourceTexture=Ke}}}}for(let Me=0;Me<R.length;Me++){let Ie=T[Me],ge=R[Me];Ie!==null&&ge!==void 0&&ge.update(Ie,me,c||o)}Q&&Q(K,me),me.detectedPlanes&&n.dispatchEvent({type:"planesdetected",data:me}),g=null}let Be=new Yp;Be.setAnimationLoop(Te),this.setAnimationLoop=function(K){Q=K},this.dispose=function(){}}},Wb=new _e,sm=new Fe;sm.set(-1,0,0,0,1,0,0,0,1);function Xb(s,e){function t(p,m){p.matrixAutoUpdate===!0&&p.updateMatrix(),m.value.copy(p.matrix)}function n(p,m){m.color.getRGB(p.fogColor.value,wu(s)),m.isFog?(p.fogNear.value=m.near,p.fogFar.value=m.far):m.isFogExp2&&(p.fogDensity.value=m.density)}function i(p,m,b,E,M){m.isNodeMaterial?m.uniformsNeedUpdate=!1:m.isMeshBasicMaterial?r(p,m):m.isMeshLambertMaterial?(r(p,m),m.envMap&&(p.envMapIntensity.value=m.envMapIntensity)):m.isMeshToonMaterial?(r(p,m),u(p,m)):m.isMeshPhongMaterial?(r(p,m),h(p,m),m.envMap&&(p.envMapIntensity.value=m.envMapIntensity)):m.isMeshStandardMaterial?(r(p,m),d(p,m),m.isMeshPhysicalMaterial&&f(p,m,M)):m.isMeshMatcapMaterial?(r(p,m),g(p,m)):m.isMeshDepthMaterial?r(p,m):m.isMeshDistanceMaterial?(r(p,m),y(p,m)):m.isMeshNormalMaterial?r(p,m):m.isLineBasicMaterial?(o(p,m),m.isLineDashedMaterial&&a(p,m)):m.isPointsMaterial?l(p,m,b,E):m.isSpriteMaterial?c(p,m):m.isShadowMaterial?(p.color.value.copy(m.color),p.opacity.value=m.opacity):m.isShaderMaterial&&(m.uniformsNeedUpdate=!1)}function r(p,m){p.opacity.value=m.opacity,m.color&&p.diffuse.value.copy(m.color),m.emissive&&p.emissive.value.copy(m.emissive).multiplyScalar(m.emissiveIntensity),m.map&&(p.map.value=m.map,t(m.map,p.mapTransform)),m.alphaMap&&(p.alphaMap.value=m.alphaMap,t(m.alphaMap,p.alphaMapTransform)),m.bumpMap&&(p.bumpMap.value=m.bumpMap,t(m.bumpMap,p.bumpMapTransform),p.bumpScale.value=m.bumpScale,m.side===Kt&&(p.bumpScale.value*=-1)),m.normalMap&&(p.normalMap.value=m.normalMap,t(m.normalMap,p.normalMapTransform),p.normalScale.value.copy(m.normalScale),m.side===Kt&&p.normalScale.value.negate()),m.displacementMap&&(p.displacementMap.value=m.displacementMap,t(m.displacementMap,p.displacementMapTransform),p.displacementScale.value=m.displacementScale,p.displacementBias.value=m.displacementBias),m.emissiveMap&&(p.emissiveMap.value=m.emissiveMap,t(m.emissiveMap,p.emissiveMapTransform)),m.specularMap&&(p.specularMap.value=m.specularMap,t(m.specularMap,p.specularMapTransform)),m.alphaTest>0&&(p.alphaTest.value=m.alphaTest);let b=e.get(m),E=b.envMap,M=b.envMapRotation;E&&(p.envMap.value=E,p.envMapRotation.value.setFromMatrix4(Wb.makeRotationFromEuler(M)).transpose(),E.isCubeTexture&&E.isRenderTargetTexture===!1&&p.envMapRotation.value.premultiply(sm),p.reflectivity.value=m.reflectivity,p.ior.value=m.ior,p.refractionRatio.value=m.refractionRatio),m.lightMap&&(p.lightMap.value=m.lightMap,p.lightMapIntensity.value=m.lightMapIntensity,t(m.lightMap,p.lightMapTransform)),m.aoMap&&(p.aoMap.value=m.aoMap,p.aoMapIntensity.value=m.aoMapIntensity,t(m.aoMap,p.aoMapTransform))}function o(p,m){p.diffuse.value.copy(m.color),p.opacity.value=m.opacity,m.map&&(p.map.value=m.map,t(m.map,p.mapTransform))}function a(p,m){p.dashSize.value=m.dashSize,p.totalSize.value=m.dashSize+m.gapSize,p.scale.value=m.scale}function l(p,m,b,E){p.diffuse.value.copy(m.color),p.opacity.value=m.opacity,p.size.value=m.size*b,p.scale.value=E*.5,m.map&&(p.map.value=m.map,t(m.map,p.uvTransform)),m.alphaMap&&(p.alphaMap.value=m.alphaMap,t(m.alphaMap,p.alphaMapTransform)),m.alphaTest>0&&(p.alphaTest.value=m.alphaTest)}function c(p,m){p.diffuse.value.copy(m.color),p.opacity.value=m.opacity,p.rotation.value=m.rotation,m.map&&(p.map.value=m.map,t(m.map,p.mapTransform)),m.alphaMap&&(p.alphaMap.value=m.alphaMap,t(m.alphaMap,p.alphaMapTransform)),m.alphaTest>0&&(p.alphaTest.value=m.alphaTest)}function h(p,m){p.specular.value.copy(m.specular),p.shininess.value=Math.max(m.shininess,1e-4)}function u(p,m){m.gradientMap&&(p.gradientMap.value=m.gradientMap)}function d(p,m){p.metalness.value=m.metalness,m.metalnessMap&&(p.metalnessMap.value=m.metalnessMap,t(m.metalnessMap,p.metalnessMapTransform)),p.roughness.value=m.roughness,m.roughnessMap&&(p.roughnessMap.value=m.roughnessMap,t(m.roughnessMap,p.roughnessMapTransform)),m.envMap&&(p.envMapIntensity.value=m.envMapIntensity)}function f(p,m,b){p.ior.value=m.ior,m.diffuseRoughness>0&&(p.diffuseRoughness.value=m.diffuseRoughness,m.diffuseRoughnessMap&&(p.diffuseRoughnessMap.value=m.diffuseRoughnessMap,t(m.diffuseRoughnessMap,p.diffuseRoughnessMapTransform))),m.sheen>0&&(p.sheenColor.value.copy(m.sheenColor).multiplyScalar(m.sheen),p.sheenRoughness.value=m.sheenRoughness,m.sheenColorMap&&(p.sheenColorMap.value=m.sheenColorMap,t(m.sheenColorMap,p.sheenColorMapTransform)),m.sheenRoughnessMap&&(p.sheenRoughnessMap.value=m.sheenRoughnessMap,t(m.sheenRoughnessMap,p.sheenRoughnessMapTransform))),m.clearcoat>0&&(p.clearcoat.value=m.clearcoat,p.clearcoatRoughness.value=m.clearcoatRoughness,m.clearcoatMap&&(p.clearcoatMap.value=m.clearcoatMap,t(m.clearcoatMap,p.clearcoatMapTransform)),m.clearcoatRoughnessMap&&(p.clearcoatRoughnessMap.value=m.clearcoatRoughnessMap,t(m.clearcoatRoughnessMap,p.clearcoatRoughnessMapTransform)),m.clearcoatNormalMap&&(p.clearcoatNormalMap.value=m.clearcoatNormalMap,t(m.clearcoatNormalMap,p.clearcoatNormalMapTransform),p.clearcoatNormalScale.value.copy(m.clearcoatNormalScale),m.side===Kt&&p.clearcoatNormalScale.value.negate())),m.dispersion>0&&(p.dispersion.value=m.dispersion),m.retroreflectivity>0&&(p.retroreflectivity.value=m.retroreflectivity),m.iridescence>0&&(p.iridescence.value=m.iridescence,p.iridescenceIOR.value=m.iridescenceIOR,p.iridescenceThicknessMinimum.value=m.iridescenceThicknessMinimum,p.iridescenceThicknessMaximum.value=m.iridescenceThicknessMaximum,m.iridescenceMap&&(p.iridescenceMap.value=m.iridescenceMap,t(m.iridescenceMap,p.iridescenceMapTransform)),m.iridescenceThicknessMap&&(p.iridescenceThicknessMap.value=m.iridescenceThicknessMap,t(m.iridescenceThicknessMap,p.iridescenceThicknessMapTransform))),m.transmission>0&&(p.transmission.value=m.transmission,p.transmissionSamplerMap.value=b.texture,p.transmissionSamplerSize.value.set(b.width,b.height),m.transmissionMap&&(p.transmissionMap.value=m.transmissionMap,t(m.transmissionMap,p.transmissionMapTransform)),p.thickness.value=m.thickness,m.thicknessMap&&(p.thicknessMap.value=m.thicknessMap,t(m.thicknessMap,p.thicknessMapTransform)),p.attenuationDistance.value=m.attenuationDistance,p.attenuationColor.value.copy(m.attenuationColor)),m.anisotropy>0&&(p.anisotropyVector.value.set(m.anisotropy*Math.cos(m.anisotropyRotation),m.anisotropy*Math.sin(m.anisotropyRotation)),m.anisotropyMap&&(p.anisotropyMap.value=m.anisotropyMap,t(m.anisotropyMap,p.anisotropyMapTransform))),p.specularIntensity.value=m.specularIntensity,p.specularColor.value.copy(m.specularColor),m.specularColorMap&&(p.specularColorMap.value=m.specularColorMap,t(m.specularColorMap,p.specularColorMapTransform)),m.specularIntensityMap&&(p.specularIntensityMap.value=m.specularIntensityMap,t(m.specularIntensityMap,p.specularIntensityMapTransform))}function g(p,m){m.matcap&&(p.matcap.value=m.matcap)}function y(p,m){let b=e.get(m).light;p.referencePosition.value.setFromMatrixPosition(b.matrixWorld),p.nearDistance.value=b.shadow.camera.near,p.farDistance.value=b.shadow.camera.far}return{refreshFogUniforms:n,refreshMaterialUniforms:i}}function qb(s,e,t,n){let i={},r={};function o(b,E){let M=E.program;n.uniformBlockBinding(b,M,i[b.id])}function a(b,E){let M=i[b.id];M===void 0&&(g(b),M=l(b),i[b.id]=M,b.addEventListener("dispose",p));let R=E.program;n.updateUBOMapping(b,R);let T=e.render.frame;r[b.id]!==T&&(c(b),r[b.id]=T)}function l(b){let E=s.createBuffer(),M=b.__size,R=b.usage;return s.bindBuffer(s.UNIFORM_BUFFER,E),s.bufferData(s.UNIFORM_BUFFER,M,R),s.bindBuffer(s.UNIFORM_BUFFER,null),E}function c(b){let E=i[b.id],M=b.uniforms,R=b.__cache;s.bindBuffer(s.UNIFORM_BUFFER,E);for(let T=0,x=M.length;T<x;T++){let w=M[T];if(Array.isArray(w))for(let O=0,I=w.length;O<I;O++)h(w[O],T,O,R);else h(w,T,0,R)}s.bindBuffer(s.UNIFORM_BUFFER,null)}function h(b,E,M,R){if(d(b,E,M,R)===!0){let T=b.__offset,x=b.value;if(Array.isArray(x)){let w=0;for(let O=0;O<x.length;O++){let I=x[O],N=y(I,!0);u(I,b.__data,w),w+=N.storage/Float32Array.BYTES_PER_ELEMENT}}else u(x,b.__data,0);s.bufferSubData(s.UNIFORM_BUFFER,T,b.__data)}}function u(b,E,M){typeof b=="number"||typeof b=="boolean"?E[M]=b:b.isMatrix3?(E[M]=b.elements[0],E[M+1]=b.elements[1],E[M+2]=b.elements[2],E[M+3]=0,E[M+4]=b.elements[3],E[M+5]=b.elements[4],E[M+6]=b.elements[5],E[M+7]=0,E[M+8]=b.elements[6],E[M+9]=b.elements[7],E[M+10]=b.elements[8],E[M+11]=0):ArrayBuffer.isView(b)?E.set(b.subarray(0,E.length-M),M):b.toArray(E,M)}function d(b,E,M,R){let T=b.value,x=E+"_"+M;if(Array.isArray(T)){R[x]===void 0&&(R[x]=[]);let w=R[x],O=!1;for(let I=0;I<T.length;I++)f(T[I],w,I)===!0&&(O=!0);return O}return f(T,R,x)}function f(b,E,M){if(E[M]===void 0)return typeof b=="number"||typeof b=="boolean"?E[M]=b:ArrayBuffer.isView(b)?E[M]=b.slice():E[M]=b.clone(),!0;{let R=E[M];if(typeof b=="number"||typeof b=="boolean"){if(R!==b)return E[M]=b,!0}else{if(ArrayBuffer.isView(b))return!0;if(R.equals(b)===!1)return R.copy(b),!0}}return!1}function g(b){let E=b.uniforms,M=0,R=16;for(let x=0,w=E.length;x<w;x++){let O=Array.isArray(E[x])?E[x]:[E[x]];for(let I=0,N=O.length;I<N;I++){let k=O[I],V=Array.isArray(k.value)?k.value:[k.value],P=Array.isArray(E[x])||Array.isArray(k.value),G=M;for(let H=0,te=V.length;H<te;H++){let X=V[H],J=y(X,P),Q=M%R,Te=Q%J.boundary,Be=Q+Te;M+=Te,Be!==0&&R-Be<J.storage&&(M+=R-Be),H===0&&(G=M),M+=J.storage}let q=k.type==="int"?Int32Array:k.type==="uint"?Uint32Array:Float32Array;k.__data=new q((M-G)/Float32Array.BYTES_PER_ELEMENT),k.__offset=G}}let T=M%R;return T>0&&(M+=R-T),b.__size=M,b.__cache={},this}function y(b,E){let M={boundary:0,storage:0};return typeof b=="number"||typeof b=="boolean"?(M.boundary=4,M.storage=4):b.isVector2?(M.boundary=8,M.storage=8):b.isVector3||b.isColor?(M.boundary=16,M.storage=12):b.isVector4?(M.boundary=16,M.storage=16):b.isMatrix3?(M.boundary=16,M.storage=48):b.isMatrix4?(M.boundary=16,M.storage=64):b.isTexture?Ee("WebGLRenderer: Texture samplers can not be part of an uniforms group."):ArrayBuffer.isView(b)?(M.boundary=16,M.storage=b.byteLength):Ee("WebGLRenderer: Unsupported uniform value type.",b),E===!0&&(M.boundary=16,M.storage=Math.ceil(M.storage/16)*16),M}function p(b){let E=b.target;E.removeEventListener("dispose",p),s.deleteBuffer(i[E.id]),delete i[E.id],delete r[E.id]}function m(){for(let b in i)s.deleteBuffer(i[b]);i={},r={}}return{bind:o,update:a,dispose:m}}var $b=new Uint16Array([12469,15057,12620,14925,13266,14620,13807,14376,14323,13990,14545,13625,14713,13328,14840,12882,14931,12528,14996,12233,15039,11829,15066,11525,15080,11295,15085,10976,15082,10705,15073,10495,13880,14564,13898,14542,13977,14430,14158,14124,14393,13732,14556,13410,14702,12996,14814,12596,14891,12291,14937,11834,14957,11489,14958,11194,14943,10803,14921,10506,14893,10278,14858,9960,14484,14039,14487,14025,14499,13941,14524,13740,14574,13468,14654,13106,14743,12678,14818,12344,14867,11893,14889,11509,14893,11180,14881,10751,14852,10428,14812,10128,14765,9754,14712,9466,14764,13480,14764,13475,14766,13440,14766,13347,14769,13070,14786,12713,14816,12387,14844,11957,14860,11549,14868,11215,14855,10751,14825,10403,14782,10044,14729,9651,14666,9352,14599,9029,14967,12835,14966,12831,14963,12804,14954,12723,14936,12564,14917,12347,14900,11958,14886,11569,14878,11247,14859,10765,14828,10401,14784,10011,14727,9600,14660,9289,14586,8893,14508,8533,15111,12234,15110,12234,15104,12216,15092,12156,15067,12010,15028,11776,14981,11500,14942,11205,14902,10752,14861,10393,14812,9991,14752,9570,14682,9252,14603,8808,14519,8445,14431,8145,15209,11449,15208,11451,15202,11451,15190,11438,15163,11384,15117,11274,15055,10979,14994,10648,14932,10343,14871,9936,14803,9532,14729,9218,14645,8742,14556,8381,14461,8020,14365,7603,15273,10603,15272,10607,15267,10619,15256,10631,15231,10614,15182,10535,15118,10389,15042,10167,14963,9787,14883,9447,14800,9115,14710,8665,14615,8318,14514,7911,14411,7507,14279,7198,15314,9675,15313,9683,15309,9712,15298,9759,15277,9797,15229,9773,15166,9668,15084,9487,14995,9274,14898,8910,14800,8539,14697,8234,14590,7790,14479,7409,14367,7067,14178,6621,15337,8619,15337,8631,15333,8677,15325,8769,15305,8871,15264,8940,15202,8909,15119,8775,15022,8565,14916,8328,14804,8009,14688,7614,14569,7287,14448,6888,14321,6483,14088,6171,15350,7402,15350,7419,15347,7480,15340,7613,15322,7804,15287,7973,15229,8057,15148,8012,15046,7846,14933,7611,14810,7357,14682,7069,14552,6656,14421,6316,14251,5948,14007,5528,15356,5942,15356,5977,15353,6119,15348,6294,15332,6551,15302,6824,15249,7044,15171,7122,15070,7050,14949,6861,14818,6611,14679,6349,14538,6067,14398,5651,14189,5311,13935,4958,15359,4123,15359,4153,15356,4296,15353,4646,15338,5160,15311,5508,15263,5829,15188,6042,15088,6094,14966,6001,14826,5796,14678,5543,14527,5287,14377,4985,14133,4586,13869,4257,15360,1563,15360,1642,15358,2076,15354,2636,15341,3350,15317,4019,15273,4429,15203,4732,15105,4911,14981,4932,14836,4818,14679,4621,14517,4386,14359,4156,14083,3795,13808,3437,15360,122,15360,137,15358,285,15355,636,15344,1274,15322,2177,15281,2765,15215,3223,15120,3451,14995,3569,14846,3567,14681,3466,14511,3305,14344,3121,14037,2800,13753,2467,15360,0,15360,1,15359,21,15355,89,15346,253,15325,479,15287,796,15225,1148,15133,1492,15008,1749,14856,1882,14685,1886,14506,1783,14324,1608,13996,1398,13702,1183]),ii=null;function Yb(){return ii===null&&(ii=new dr($b,16,16,Ji,bn),ii.name="DFG_LUT",ii.minFilter=St,ii.magFilter=St,ii.wrapS=Cn,ii.wrapT=Cn,ii.generateMipmaps=!1,ii.needsUpdate=!0),ii}var Ar=class{constructor(e={}){let{canvas:t=yp(),context:n=null,depth:i=!0,stencil:r=!1,alpha:o=!1,antialias:a=!1,premultipliedAlpha:l=!0,preserveDrawingBuffer:c=!1,powerPreference:h="default",failIfMajorPerformanceCaveat:u=!1,reversedDepthBuffer:d=!1,outputBufferType:f=pn}=e;this.isWebGLRenderer=!0;let g;if(n!==null){if(typeof WebGLRenderingContext<"u"&&n instanceof WebGLRenderingContext)throw new Error("THREE.WebGLRenderer: WebGL 1 is not supported since r163.");g=n.getContextAttributes().alpha}else g=o;let y=f,p=new Set([ll,al,ol]),m=new Set([pn,Vn,Mr,As,il,sl]),b=new Uint32Array(4),E=new Int32Array(4),M={textures:[],min:[],max:[],resolution:[]},R=null,T=null,x=[],w=[],O=null;this.domElement=t,this.debug={checkShaderErrors:!0,diagnostics:{keywords:!1},onShaderError:null},this.autoClear=!0,this.autoClearColor=!0,this.autoClearDepth=!0,this.autoClearStencil=!0,this.sortObjects=!0,this.clippingPlanes=[],this.localClippingEnabled=!1,this.toneMapping=ti,this.toneMappingExposure=1,this.transmissionResolutionScale=1;let I=this,N=!1,k=null,V=null,P=null,G=null;this._outputColorSpace=ot;let q=0,H=0,te=null,X=-1,J=null,Q=new at,Te=new at,Be=null,K=new ve(0),me=0,Me=t.width,Ie=t.height,ge=1,He=null,Rt=null,Ne=new at(0,0,Me,Ie),st=new at(0,0,Me,Ie),ct=!1,Ke=new Vi,Xt=new ka,Lt=!1,hn=!1,xt=new _e,qn=new S,Bt=new at,Sn={background:null,fog:null,environment:null,overrideMaterial:null,isScene:!0},Tn=!1;function An(){return te===null?ge:1}let D=n;function En(_,L){return t.getContext(_,L)}let pt,mt,de,Dt,Le,ke,A,v,F,ee,Z,se,ce,$,Y,oe,C,j,W,ae,ie,re,Re;try{let _={alpha:!0,depth:i,stencil:r,antialias:a,premultipliedAlpha:l,preserveDrawingBuffer:c,powerPreference:h,failIfMajorPerformanceCaveat:u};if("setAttribute"in t&&t.setAttribute("data-engine",`three.js r${"187"}`),t.addEventListener("webglcontextlost",Ce,!1),t.addEventListener("webglcontextrestored",Ge,!1),t.addEventListener("webglcontextcreationerror",fe,!1),D===null){let L="webgl2";if(D=En(L,_),D===null)throw En(L)?new Error("THREE.WebGLRenderer: Error creating WebGL context with your selected attributes."):new Error("THREE.WebGLRenderer: Error creating WebGL context.")}Ve()}catch(_){throw t.removeEventListener("webglcontextlost",Ce,!1),t.removeEventListener("webglcontextrestored",Ge,!1),t.removeEventListener("webglcontextcreationerror",fe,!1),Oe("WebGLRenderer: "+_.message),_}function Ve(){pt=new r_(D),pt.init(),ie=new Hb(D,pt),mt=new Yv(D,pt,e,ie),de=new Bb(D,pt),mt.reversedDepthBuffer&&d&&de.buffers.depth.setReversed(!0),V=D.createFramebuffer(),P=D.createFramebuffer(),G=D.createFramebuffer(),Dt=new l_(D),Le=new Tb,ke=new zb(D,pt,de,Le,mt,ie,Dt),A=new s_(I),v=new hx(D),re=new qv(D,v),F=new o_(D,v,Dt,re),ee=new h_(D,F,v,re,Dt),j=new c_(D,mt,ke),Y=new Kv(Le),Z=new Sb(I,A,pt,mt,re,Y),se=new Xb(I,Le),ce=new Eb,$=new Db(pt),C=new Xv(I,A,de,ee,g,l),oe=new kb(I,ee,mt),Re=new qb(D,Dt,mt,de),W=new $v(D,pt,Dt),ae=new a_(D,pt,Dt),Dt.programs=Z.programs,I.capabilities=mt,I.extensions=pt,I.properties=Le,I.renderLists=ce,I.shadowMap=oe,I.state=de,I.info=Dt}y!==pn&&(O=new d_(y,t.width,t.height,a,i,r));let ne=new Uu(I,D);this.xr=ne,this.getContext=function(){return D},this.getContextAttributes=function(){return D.getContextAttributes()},this.forceContextLoss=function(){let _=pt.get("WEBGL_lose_context");_&&_.loseContext()},this.forceContextRestore=function(){let _=pt.get("WEBGL_lose_context");_&&_.restoreContext()},this.getPixelRatio=function(){return ge},this.setPixelRatio=function(_){_!==void 0&&(ge=_,this.setSize(Me,Ie,!1))},this.getSize=function(_){return _.set(Me,Ie)},this.setSize=function(_,L,z=!0){if(ne.isPresenting){Ee("WebGLRenderer: Can't change size while VR device is presenting.");return}Me=_,Ie=L,t.width=Math.floor(_*ge),t.height=Math.floor(L*ge),z===!0&&(t.style.width=_+"px",t.style.height=L+"px"),O!==null&&O.setSize(t.width,t.height),this.setViewport(0,0,_,L)},this.getDrawingBufferSize=function(_){return _.set(Me*ge,Ie*ge).floor()},this.setDrawingBufferSize=function(_,L,z){Me=_,Ie=L,ge=z,t.width=Math.floor(_*z),t.height=Math.floor(L*z),this.setViewport(0,0,_,L)},this.setEffects=function(_){if(y===pn){Oe("WebGLRenderer: setEffects() requires outputBufferType set to HalfFloatType or FloatType.");return}if(_){for(let L=0;L<_.length;L++)if(_[L].isOutputPass===!0){Ee("WebGLRenderer: OutputPass is not needed in setEffects(). Tone mapping and color space conversion are applied automatically.");break}}O.setEffects(_||[])},this.getCurrentViewport=function(_){return _.copy(Q)},this.getViewport=function(_){return _.copy(Ne)},this.setViewport=function(_,L,z,U){_.isVector4?Ne.set(_.x,_.y,_.z,_.w):Ne.set(_,L,z,U),de.viewport(Q.copy(Ne).multiplyScalar(An()).round())},this.getScissor=function(_){return _.copy(st)},this.setScissor=function(_,L,z,U){_.isVector4?st.set(_.x,_.y,_.z,_.w):st.set(_,L,z,U),de.scissor(Te.copy(st).multiplyScalar(An()).round())},this.getScissorTest=function(){return ct},this.setScissorTest=function(_){de.setScissorTest(ct=_)},this.setOpaqueSort=function(_){He=_},this.setTransparentSort=function(_){Rt=_},this.getClearColor=function(_){return _.copy(C.getClearColor())},this.setClearColor=function(){C.setClearColor(...arguments)},this.getClearAlpha=function(){return C.getClearAlpha()},this.setClearAlpha=function(){C.setClearAlpha(...arguments)},this.clear=function(_=!0,L=!0,z=!0){let U=0;if(_){let B=!1;if(te!==null){let he=te.texture.format;B=p.has(he)}if(B){let he=te.texture.type,be=m.has(he),le=C.getClearColor(),xe=C.getClearAlpha(),Ae=le.r,ze=le.g,je=le.b;be?(b[0]=Ae,b[1]=ze,b[2]=je,b[3]=xe,D.clearBufferuiv(D.COLOR,0,b)):(E[0]=Ae,E[1]=ze,E[2]=je,E[3]=xe,D.clearBufferiv(D.COLOR,0,E))}else U|=D.COLOR_BUFFER_BIT}L&&(U|=D.DEPTH_BUFFER_BIT,this.state.buffers.depth.setMask(!0)),z&&(U|=D.STENCIL_BUFFER_BIT,this.state.buffers.stencil.setMask(4294967295)),U!==0&&D.clear(U)},this.clearColor=function(){this.clear(!0,!1,!1)},this.clearDepth=function(){this.clear(!1,!0,!1)},this.clearStencil=function(){this.clear(!1,!1,!0)},this.setNodesHandler=function(_){_.setRenderer(this),k=_},this.dispose=function(){t.removeEventListener("webglcontextlost",Ce,!1),t.removeEventListener("webglcontextrestored",Ge,!1),t.removeEventListener("webglcontextcreationerror",fe,!1),C.dispose(),ce.dispose(),$.dispose(),ke.dispose(),Le.dispose(),A.dispose(),ee.dispose(),F.dispose(),re.dispose(),Re.dispose(),Z.dispose(),ne.dispose(),ne.removeEventListener("sessionstart",Fd),ne.removeEventListener("sessionend",kd),is.stop()};function Ce(_){_.preventDefault(),Zr("WebGLRenderer: Context Lost."),N=!0}function Ge(){Zr("WebGLRenderer: Context Restored."),N=!1;let _=Dt.autoReset,L=oe.enabled,z=oe.autoUpdate,U=oe.needsUpdate,B=oe.type;Ve(),Dt.autoReset=_,oe.enabled=L,oe.autoUpdate=z,oe.needsUpdate=U,oe.type=B}function fe(_){Oe("WebGLRenderer: A WebGL context could not be created. Reason: ",_.statusMessage)}function rt(_){let L=_.target;L.removeEventListener("dispose",rt),zt(L)}function zt(_){Li(_),Le.remove(_)}function Li(_){let L=Le.get(_).programs;L!==void 0&&(L.forEach(function(z){Z.releaseProgram(z)}),_.isShaderMaterial&&Z.releaseShaderCache(_))}this.renderBufferDirect=function(_,L,z,U,B,he){L===null&&(L=Sn);let be=B.isMesh&&B.matrixWorld.determinantAffine()<0,le=s0(_,L,z,U,B);de.setMaterial(U,be);let xe=z.index,Ae=1;if(U.wireframe===!0){if(xe=F.getWireframeAttribute(z),xe===void 0)return;Ae=2}let ze=z.drawRange,je=z.attributes.position,we=ze.start*Ae,Ze=(ze.start+ze.count)*Ae;he!==null&&(we=Math.max(we,he.start*Ae),Ze=Math.min(Ze,(he.start+he.count)*Ae)),xe!==null?(we=Math.max(we,0),Ze=Math.min(Ze,xe.count)):je!=null&&(we=Math.max(we,0),Ze=Math.min(Ze,je.count));let Ct=Ze-we;if(Ct<0||Ct===1/0)return;re.setup(B,U,le,z,xe);let ft,ht=W;if(xe!==null&&(ft=v.get(xe),ht=ae,ht.setIndex(ft)),B.isMesh)U.wireframe===!0?(de.setLineWidth(U.wireframeLinewidth*An()),ht.setMode(D.LINES)):ht.setMode(D.TRIANGLES);else if(B.isLine){let Zt=U.linewidth;Zt===void 0&&(Zt=1),de.setLineWidth(Zt*An()),B.isLineSegments?ht.setMode(D.LINES):B.isLineLoop?ht.setMode(D.LINE_LOOP):ht.setMode(D.LINE_STRIP)}else B.isPoints?ht.setMode(D.POINTS):B.isSprite&&ht.setMode(D.TRIANGLES);if(B.isBatchedMesh)if(pt.get("WEBGL_multi_draw"))ht.renderMultiDraw(B._multiDrawStarts,B._multiDrawCounts,B._multiDrawCount);else{let Zt=B._multiDrawStarts,Se=B._multiDrawCounts,rn=B._multiDrawCount,et=xe?v.get(xe).bytesPerElement:1,ss=Le.get(U).currentProgram.getUniforms();for(let Jt=0;Jt<rn;Jt++)ss.setValue(D,"_gl_DrawID",Jt),ht.render(Zt[Jt]/et,Se[Jt])}else if(B.isInstancedMesh)ht.renderInstances(we,Ct,B.count);else if(z.isInstancedBufferGeometry){let Zt=z._maxInstanceCount!==void 0?z._maxInstanceCount:1/0,Se=Math.min(z.instanceCount,Zt);ht.renderInstances(we,Ct,Se)}else ht.render(we,Ct)};function Ud(_,L,z,U){k!==null&&_.isNodeMaterial&&k.setObject(U,_),Lt===!0&&Y.setState(_,z,!1),_.transparent===!0&&_.side===It&&_.forceSinglePass===!1?(_.side=Kt,_.needsUpdate=!0,Ur(_,L,U),_.side=ei,_.needsUpdate=!0,Ur(_,L,U),_.side=It):Ur(_,L,U)}this.compile=function(_,L,z=null){z===null&&(z=_),k!==null&&k.renderStart(_,L,z),T=$.get(z),T.init(L),w.push(T),z.traverseVisible(function(B){B.isLight&&B.layers.test(L.layers)&&(T.pushLight(B),B.castShadow&&T.pushShadow(B))}),_!==z&&_.traverseVisible(function(B){B.isLight&&B.layers.test(L.layers)&&(T.pushLight(B),B.castShadow&&T.pushShadow(B))}),T.setupLights(),k!==null&&k.updateLights(T.state.lightsArray),hn=this.localClippingEnabled,Lt=Y.init(this.clippingPlanes,hn),Lt===!0&&Y.setGlobalState(this.clippingPlanes,L),k!==null&&oe.render(T.state.shadowsArray,z,L);let U=new Set;return _.traverse(function(B){if(!(B.isMesh||B.isPoints||B.isLine||B.isSprite))return;let he=B.material;if(he)if(Array.isArray(he))for(let be=0;be<he.length;be++){let le=he[be];Ud(le,z,L,B),U.add(le)}else Ud(he,z,L,B),U.add(he)}),T=w.pop(),k!==null&&k.renderEnd(),U},this.compileAsync=function(_,L,z=null){let U=this.compile(_,L,z);return new Promise(B=>{function he(){if(U.forEach(function(be){let xe=Le.get(be).currentProgram;(xe===void 0||xe.isReady())&&U.delete(be)}),U.size===0){B(_);return}setTimeout(he,10)}pt.get("KHR_parallel_shader_compile")!==null?he():setTimeout(he,10)})};let oh=null;function n0(_){oh&&oh(_)}function Fd(){is.stop()}function kd(){is.start()}let is=new Yp;is.setAnimationLoop(n0),typeof self<"u"&&is.setContext(self),this.setAnimationLoop=function(_){oh=_,ne.setAnimationLoop(_),_===null?is.stop():is.start()},ne.addEventListener("sessionstart",Fd),ne.addEventListener("sessionend",kd),this.render=function(_,L){if(L!==void 0&&L.isCamera!==!0){Oe("WebGLRenderer.render: camera is not an instance of THREE.Camera.");return}if(N===!0)return;k!==null&&k.renderStart(_,L);let z=ne.enabled===!0&&ne.isPresenting===!0,U=O!==null&&(te===null||z)&&O.begin(I,te);if(_.matrixWorldAutoUpdate===!0&&_.updateMatrixWorld(),L.parent===null&&L.matrixWorldAutoUpdate===!0&&L.updateMatrixWorld(),ne.enabled===!0&&ne.isPresenting===!0&&(O===null||O.isCompositing()===!1)&&(ne.cameraAutoUpdate===!0&&ne.updateCamera(L),L=ne.getCamera()),_.isScene===!0&&_.onBeforeRender(I,_,L,te),T=$.get(_,w.length),T.init(L),T.state.textureUnits=ke.getTextureUnits(),w.push(T),xt.multiplyMatrices(L.projectionMatrix,L.matrixWorldInverse),L.isArrayCamera?Xt.setFromArrayCamera(L):Ke.setFromProjectionMatrix(xt,Pn,L.reversedDepth),hn=this.localClippingEnabled,Lt=Y.init(this.clippingPlanes,hn),R=ce.get(_,x.length),R.init(),x.push(R),this.info.render.frame++,ne.enabled===!0&&ne.isPresenting===!0){let be=I.xr.getDepthSensingMesh();be!==null&&ah(be,L,-1/0,I.sortObjects)}ah(_,L,0,I.sortObjects),R.finish(),k!==null&&k.updateLights(T.state.lightsArray),I.sortObjects===!0&&R.sort(He,Rt),Tn=ne.enabled===!1||ne.isPresenting===!1||ne.hasDepthSensing()===!1,Tn&&C.addToRenderList(R,_),this.info.autoReset===!0&&this.info.reset(),Lt===!0&&Y.beginShadows();let B=T.state.shadowsArray;if(oe.render(B,_,L),Lt===!0&&Y.endShadows(),(U&&O.hasRenderPass())===!1){let be=R.opaque,le=R.transmissive;if(T.setupLights(),L.isArrayCamera){let xe=L.cameras;if(le.length>0)for(let Ae=0,ze=xe.length;Ae<ze;Ae++){let je=xe[Ae];zd(be,le,_,je)}Tn&&C.render(_);for(let Ae=0,ze=xe.length;Ae<ze;Ae++){let je=xe[Ae];Bd(R,_,je,je.viewport)}}else le.length>0&&zd(be,le,_,L),Tn&&C.render(_),Bd(R,_,L)}te!==null&&H===0&&(ke.updateMultisampleRenderTarget(te),ke.updateRenderTargetMipmap(te)),U&&O.end(I),_.isScene===!0&&_.onAfterRender(I,_,L),re.resetDefaultState(),X=-1,J=null,w.pop(),w.length>0?(T=w[w.length-1],ke.setTextureUnits(T.state.textureUnits),Lt===!0&&Y.setGlobalState(I.clippingPlanes,T.state.camera)):T=null,x.pop(),x.length>0?R=x[x.length-1]:R=null,k!==null&&k.renderEnd()};function ah(_,L,z,U){if(_.visible===!1)return;if(_.layers.test(L.layers)){if(_.isGroup)z=_.renderOrder;else if(_.isLOD)_.autoUpdate===!0&&_.update(L);else if(_.isLight)T.pushLight(_),_.castShadow&&T.pushShadow(_);else if(_.isSprite){let be=L.isArrayCamera?Xt:Ke;if(!_.frustumCulled||_.intersectsFrustum(be)){U&&Bt.setFromMatrixPosition(_.matrixWorld).applyMatrix4(xt);let le=ee.update(_),xe=_.material;xe.visible&&R.push(_,le,xe,z,Bt.z,null,L)}}else if(_.isMesh||_.isLine||_.isPoints){let be=L.isArrayCamera?Xt:Ke;if(!_.frustumCulled||_.intersectsFrustum(be)){let le=ee.update(_),xe=_.material;if(U&&(_.boundingSphere!==void 0?(_.boundingSphere===null&&_.computeBoundingSphere(),Bt.copy(_.boundingSphere.center)):(le.boundingSphere===null&&le.computeBoundingSphere(),Bt.copy(le.boundingSphere.center)),Bt.applyMatrix4(_.matrixWorld).applyMatrix4(xt)),Array.isArray(xe)){let Ae=le.groups;for(let ze=0,je=Ae.length;ze<je;ze++){let we=Ae[ze],Ze=xe[we.materialIndex];Ze&&Ze.visible&&R.push(_,le,Ze,z,Bt.z,we,L)}}else xe.visible&&R.push(_,le,xe,z,Bt.z,null,L)}}}let he=_.children;for(let be=0,le=he.length;be<le;be++)ah(he[be],L,z,U)}function Bd(_,L,z,U){let{opaque:B,transmissive:he,transparent:be}=_;T.setupLightsView(z),Lt===!0&&Y.setGlobalState(I.clippingPlanes,z),U&&de.viewport(Q.copy(U)),B.length>0&&$o(B,L,z),he.length>0&&$o(he,L,z),be.length>0&&$o(be,L,z),de.buffers.depth.setTest(!0),de.buffers.depth.setMask(!0),de.buffers.color.setMask(!0),de.setPolygonOffset(!1)}function zd(_,L,z,U){if((z.isScene===!0?z.overrideMaterial:null)!==null)return;if(T.state.transmissionRenderTarget[U.id]===void 0){let we=pt.has("EXT_color_buffer_half_float")||pt.has("EXT_color_buffer_float");T.state.transmissionRenderTarget[U.id]=new Tt(1,1,{generateMipmaps:!0,type:we?bn:pn,minFilter:Ln,samples:Math.max(4,mt.samples),stencilBuffer:r,resolveDepthBuffer:!1,resolveStencilBuffer:!1,storeMultisampledDepthBuffer:!1,storeMultisampledStencilBuffer:!1,colorSpace:Xe.workingColorSpace})}let he=T.state.transmissionRenderTarget[U.id],be=U.viewport||Q;he.setSize(be.z*I.transmissionResolutionScale,be.w*I.transmissionResolutionScale);let le=I.getRenderTarget(),xe=I.getActiveCubeFace(),Ae=I.getActiveMipmapLevel();I.setRenderTarget(he),I.getClearColor(K),me=I.getClearAlpha(),me<1&&I.setClearColor(16777215,.5),I.clear(),Tn&&C.render(z);let ze=I.toneMapping;I.toneMapping=ti;let je=U.viewport;if(U.viewport!==void 0&&(U.viewport=void 0),T.setupLightsView(U),Lt===!0&&Y.setGlobalState(I.clippingPlanes,U),$o(_,z,U),ke.updateMultisampleRenderTarget(he),ke.updateRenderTargetMipmap(he),pt.has("WEBGL_multisampled_render_to_texture")===!1){let we=!1;for(let Ze=0,Ct=L.length;Ze<Ct;Ze++){let ft=L[Ze],{object:ht,geometry:Zt,material:Se,group:rn}=ft;if(Se.side===It&&ht.layers.test(U.layers)){let et=Se.side;Se.side=Kt,Se.needsUpdate=!0,Hd(ht,z,U,Zt,Se,rn),Se.side=et,Se.needsUpdate=!0,we=!0}}we===!0&&(ke.updateMultisampleRenderTarget(he),ke.updateRenderTargetMipmap(he))}I.setRenderTarget(le,xe,Ae),I.setClearColor(K,me),je!==void 0&&(U.viewport=je),I.toneMapping=ze}function $o(_,L,z){let U=L.isScene===!0?L.overrideMaterial:null;for(let B=0,he=_.length;B<he;B++){let be=_[B],{object:le,geometry:xe,group:Ae}=be,ze=be.material;ze.allowOverride===!0&&U!==null&&(ze=U),le.layers.test(z.layers)&&Hd(le,L,z,xe,ze,Ae)}}function Hd(_,L,z,U,B,he){k!==null&&B.isNodeMaterial&&k.setObject(_,B),_.onBeforeRender(I,L,z,U,B,he),_.modelViewMatrix.multiplyMatrices(z.matrixWorldInverse,_.matrixWorld),_.normalMatrix.getNormalMatrix(_.modelViewMatrix),B.onBeforeRender(I,L,z,U,_,he),B.transparent===!0&&B.side===It&&B.forceSinglePass===!1?(B.side=Kt,B.needsUpdate=!0,I.renderBufferDirect(z,L,U,B,_,he),B.side=ei,B.needsUpdate=!0,I.renderBufferDirect(z,L,U,B,_,he),B.side=It):I.renderBufferDirect(z,L,U,B,_,he),_.onAfterRender(I,L,z,U,B,he)}function Gd(_){let L=0;for(let z of _)z.texture!==null&&L++;return L}function Ur(_,L,z){L.isScene!==!0&&(L=Sn);let U=Le.get(_),B=T.state.lights,he=T.state.shadowsArray,be=B.state.version,le=Z.getParameters(_,B.state,he,L,z,T.state.lightProbeGridArray),xe=Z.getProgramCacheKey(le),Ae=U.programs;U.environment=_.isMeshStandardMaterial||_.isMeshLambertMaterial||_.isMeshPhongMaterial?L.environment:null,U.fog=L.fog;let ze=_.isMeshStandardMaterial||_.isMeshLambertMaterial&&!_.envMap||_.isMeshPhongMaterial&&!_.envMap;U.envMap=A.get(_.envMap||U.environment,ze),U.envMapRotation=U.environment!==null&&_.envMap===null?L.environmentRotation:_.envMapRotation,Ae===void 0&&(_.addEventListener("dispose",rt),Ae=new Map,U.programs=Ae,U.programVariants=new Map);let je=Ae.get(xe);if(je!==void 0){if(U.currentProgram===je&&U.lightsStateVersion===be)return Wd(_,le),je}else le.uniforms=Z.getUniforms(_),k!==null&&_.isNodeMaterial&&k.build(_,z,le),_.onBeforeCompile(le,I),je=Z.acquireProgram(le,xe),Ae.set(xe,je),U.uniforms=le.uniforms;let we=U.uniforms;return(!_.isShaderMaterial&&!_.isRawShaderMaterial||_.clipping===!0)&&(we.clippingPlanes=Y.uniform),Wd(_,le),U.needsLights=o0(_),U.lightsStateVersion=be,U.needsLights&&(we.ambientLightColor.value=B.state.ambient,we.lightProbe.value=B.state.probe,we.sunLights.value=B.state.sun,we.sunLightShadows.value=B.state.sunShadow,we.directionalLights.value=B.state.directional,we.directionalLightShadows.value=B.state.directionalShadow,we.spotLights.value=B.state.spot,we.spotLightShadows.value=B.state.spotShadow,we.rectAreaLights.value=B.state.rectArea,we.ltc_1.value=B.state.rectAreaLTC1,we.ltc_2.value=B.state.rectAreaLTC2,we.pointLights.value=B.state.point,we.pointLightShadows.value=B.state.pointShadow,we.hemisphereLights.value=B.state.hemi,we.sunShadowMatrix.value=B.state.sunShadowMatrix,we.sunShadowCascade.value=B.state.sunShadowCascade,we.directionalShadowMatrix.value=B.state.directionalShadowMatrix,we.spotLightMatrix.value=B.state.spotLightMatrix,we.spotLightMap.value=B.state.spotLightMap,we.pointShadowMatrix.value=B.state.pointShadowMatrix),U.numLightProbeGrids=Gd(T.state.lightProbeGridArray),U.currentProgram=je,U.uniformsList=null,je}function i0(_,L,z,U,B){let he=Le.get(_),be=he.currentProgram.id+","+U+","+B,le=he.programVariants.get(be);return le===void 0?(le=Ur(_,L,z),he.programVariants.set(be,le)):(he.currentProgram=le,he.uniformsList=null,he.outputColorSpace=U,he.toneMapping=B),le}function Vd(_){if(_.uniformsList===null){let L=_.currentProgram.getUniforms();_.uniformsList=Sr.seqWithValue(L.seq,_.uniforms)}return _.uniformsList}function Wd(_,L){let z=Le.get(_);z.outputColorSpace=L.outputColorSpace,z.batching=L.batching,z.batchingColor=L.batchingColor,z.instancing=L.instancing,z.instancingColor=L.instancingColor,z.instancingMorph=L.instancingMorph,z.skinning=L.skinning,z.morphTargets=L.morphTargets,z.morphNormals=L.morphNormals,z.morphColors=L.morphColors,z.morphTargetsCount=L.morphTargetsCount,z.numClippingPlanes=L.numClippingPlanes,z.numIntersection=L.numClipIntersection,z.vertexAlphas=L.vertexAlphas,z.vertexTangents=L.vertexTangents,z.toneMapping=L.toneMapping}function s0(_,L,z,U,B){L.isScene!==!0&&(L=Sn),ke.resetTextureUnits();let he=L.fog,be=U.isMeshStandardMaterial||U.isMeshLambertMaterial||U.isMeshPhongMaterial?L.environment:null,le=te===null?I.outputColorSpace:te.isXRRenderTarget===!0?te.texture.colorSpace:Xe.workingColorSpace,xe=U.isMeshStandardMaterial||U.isMeshLambertMaterial&&!U.envMap||U.isMeshPhongMaterial&&!U.envMap,Ae=A.get(U.envMap||be,xe),ze=U.vertexColors===!0&&!!z.attributes.color&&z.attributes.color.itemSize===4,je=!!z.attributes.tangent&&(!!U.normalMap||U.anisotropy>0),we=!!z.morphAttributes.position,Ze=!!z.morphAttributes.normal,Ct=!!z.morphAttributes.color,ft=ti;U.toneMapped&&(te===null||te.isXRRenderTarget===!0)&&(ft=I.toneMapping);let ht=z.morphAttributes.position||z.morphAttributes.normal||z.morphAttributes.color,Zt=ht!==void 0?ht.length:0,Se=Le.get(U),rn=T.state.lights;if(Lt===!0&&(hn===!0||_!==J)){let yt=_===J&&U.id===X;Y.setState(U,_,yt)}let et=!1,ss=!1;U.version===Se.__version?Se.needsLights&&Se.lightsStateVersion!==rn.state.version||B.isBatchedMesh&&Se.batching===!1||!B.isBatchedMesh&&Se.batching===!0||B.isBatchedMesh&&Se.batchingColor===!0&&B._colorsTexture===null||B.isBatchedMesh&&Se.batchingColor===!1&&B._colorsTexture!==null||B.isInstancedMesh&&Se.instancing===!1||!B.isInstancedMesh&&Se.instancing===!0||B.isSkinnedMesh&&Se.skinning===!1||!B.isSkinnedMesh&&Se.skinning===!0||B.isInstancedMesh&&Se.instancingColor===!0&&B.instanceColor===null||B.isInstancedMesh&&Se.instancingColor===!1&&B.instanceColor!==null||B.isInstancedMesh&&Se.instancingMorph===!0&&B.morphTexture===null||B.isInstancedMesh&&Se.instancingMorph===!1&&B.morphTexture!==null||Se.envMap!==Ae||U.fog===!0&&Se.fog!==he||Se.numClippingPlanes!==void 0&&(Se.numClippingPlanes!==Y.numPlanes||Se.numIntersection!==Y.numIntersection)||Se.vertexAlphas!==ze||Se.vertexTangents!==je||Se.morphTargets!==we||Se.morphNormals!==Ze||Se.morphColors!==Ct||Se.morphTargetsCount!==Zt||Se.numLightProbeGrids!==Gd(T.state.lightProbeGridArray)?et=!0:(Se.outputColorSpace!==le||Se.toneMapping!==ft)&&(ss=!0):(et=!0,Se.__version=U.version);let Jt=Se.currentProgram;(et===!0||ss===!0)&&(Jt=ss===!0?i0(U,L,B,le,ft):Ur(U,L,B),k&&U.isNodeMaterial&&k.onUpdateProgram(U,Jt,Se));let Yo=!1,Di=!1,rs=!1,Je=Jt.getUniforms(),qt=Se.uniforms;if(de.useProgram(Jt.program)&&(Yo=!0,Di=!0,rs=!0),U.id!==X&&(X=U.id,Di=!0),Yo||J!==_){de.buffers.depth.getReversed()&&_.reversedDepth!==!0&&(_._reversedDepth=!0,_.updateProjectionMatrix()),Je.setValue(D,"projectionMatrix",_.projectionMatrix),Je.setValue(D,"viewMatrix",_.matrixWorldInverse);let Ht=Je.map.cameraPosition;Ht!==void 0&&Ht.setValue(D,qn.setFromMatrixPosition(_.matrixWorld)),mt.logarithmicDepthBuffer&&Je.setValue(D,"logDepthBufFC",2/(Math.log(_.far+1)/Math.LN2)),(U.isMeshPhongMaterial||U.isMeshToonMaterial||U.isMeshLambertMaterial||U.isMeshBasicMaterial||U.isMeshStandardMaterial||U.isShaderMaterial)&&Je.setValue(D,"isOrthographic",_.isOrthographicCamera===!0),J!==_&&(J=_,Di=!0,rs=!0)}if(Se.needsLights&&(rn.state.sunShadowMap.length>0&&Je.setValue(D,"sunShadowMap",rn.state.sunShadowMap,ke),rn.state.directionalShadowMap.length>0&&Je.setValue(D,"directionalShadowMap",rn.state.directionalShadowMap,ke),rn.state.spotShadowMap.length>0&&Je.setValue(D,"spotShadowMap",rn.state.spotShadowMap,ke),rn.state.pointShadowMap.length>0&&Je.setValue(D,"pointShadowMap",rn.state.pointShadowMap,ke)),B.isSkinnedMesh){Je.setOptional(D,B,"bindMatrix"),Je.setOptional(D,B,"bindMatrixInverse");let yt=B.skeleton;yt&&(yt.boneTexture===null&&yt.computeBoneTexture(),Je.setValue(D,"boneTexture",yt.boneTexture,ke))}B.isBatchedMesh&&(Je.setOptional(D,B,"batchingTexture"),Je.setValue(D,"batchingTexture",B._matricesTexture,ke),Je.setOptional(D,B,"batchingIdTexture"),Je.setValue(D,"batchingIdTexture",B._indirectTexture,ke),Je.setOptional(D,B,"batchingColorTexture"),B._colorsTexture!==null&&Je.setValue(D,"batchingColorTexture",B._colorsTexture,ke));let On=z.morphAttributes;if((On.position!==void 0||On.normal!==void 0||On.color!==void 0)&&j.update(B,z,Jt),(Di||Se.receiveShadow!==B.receiveShadow)&&(Se.receiveShadow=B.receiveShadow,Je.setValue(D,"receiveShadow",B.receiveShadow)),(U.isMeshStandardMaterial||U.isMeshLambertMaterial||U.isMeshPhongMaterial)&&U.envMap===null&&L.environment!==null&&(qt.envMapIntensity.value=L.environmentIntensity),qt.dfgLUT!==void 0&&(qt.dfgLUT.value=Yb()),Di){if(Je.setValue(D,"toneMappingExposure",I.toneMappingExposure),Se.needsLights&&r0(qt,rs),he&&U.fog===!0&&se.refreshFogUniforms(qt,he),se.refreshMaterialUniforms(qt,U,ge,Ie,T.state.transmissionRenderTarget[_.id]),Se.needsLights&&Se.numLightProbeGrids>0){let yt=M,Ht=0;for(let ci of T.state.lightProbeGridArray)ci.texture!==null&&(yt.textures[Ht]=ci.texture,yt.min[Ht]=ci.boundingBox.min,yt.max[Ht]=ci.boundingBox.max,yt.resolution[Ht]=ci.resolution,Ht++);for(let ci in yt)yt[ci].length=Ht;qt.probesSH.value=yt.textures,qt.probesMin.value=yt.min,qt.probesMax.value=yt.max,qt.probesResolution.value=yt.resolution}Sr.upload(D,Vd(Se),qt,ke)}if(U.isShaderMaterial&&U.uniformsNeedUpdate===!0&&(Sr.upload(D,Vd(Se),qt,ke),U.uniformsNeedUpdate=!1),U.isSpriteMaterial&&Je.setValue(D,"center",B.center),Je.setValue(D,"modelViewMatrix",B.modelViewMatrix),Je.setValue(D,"normalMatrix",B.normalMatrix),Je.setValue(D,"modelMatrix",B.matrixWorld),U.uniformsGroups!==void 0){let yt=U.uniformsGroups;for(let Ht=0,ci=yt.length;Ht<ci;Ht++){let qd=yt[Ht];Re.update(qd,Jt),Re.bind(qd,Jt)}}return Jt}function r0(_,L){_.ambientLightColor.needsUpdate=L,_.lightProbe.needsUpdate=L,_.sunLights.needsUpdate=L,_.sunLightShadows.needsUpdate=L,_.directionalLights.needsUpdate=L,_.directionalLightShadows.needsUpdate=L,_.pointLights.needsUpdate=L,_.pointLightShadows.needsUpdate=L,_.spotLights.needsUpdate=L,_.spotLightShadows.needsUpdate=L,_.rectAreaLights.needsUpdate=L,_.hemisphereLights.needsUpdate=L}function o0(_){return _.isMeshLambertMaterial||_.isMeshToonMaterial||_.isMeshPhongMaterial||_.isMeshStandardMaterial||_.isShadowMaterial||_.isShaderMaterial&&_.lights===!0}this.getActiveCubeFace=function(){return q},this.getActiveMipmapLevel=function(){return H},this.getRenderTarget=function(){return te},this.setRenderTargetTextures=function(_,L,z){let U=Le.get(_);U.__autoAllocateDepthBuffer=_.resolveDepthBuffer===!1,U.__autoAllocateDepthBuffer===!1&&(U.__useRenderToTexture=!1),Le.get(_.texture).__webglTexture=L,Le.get(_.depthTexture).__webglTexture=U.__autoAllocateDepthBuffer?void 0:z,U.__hasExternalTextures=!0},this.setRenderTargetFramebuffer=function(_,L){let z=Le.get(_);z.__webglFramebuffer=L,z.__useDefaultFramebuffer=L===void 0},this.setRenderTarget=function(_,L=0,z=0){te=_,q=L,H=z;let U=null,B=!1,he=!1;if(_){let le=Le.get(_);if(le.__useDefaultFramebuffer!==void 0){de.bindFramebuffer(D.FRAMEBUFFER,le.__webglFramebuffer),Q.copy(_.viewport),Te.copy(_.scissor),Be=_.scissorTest,de.viewport(Q),de.scissor(Te),de.setScissorTest(Be),X=-1;return}else if(le.__webglFramebuffer===void 0)ke.setupRenderTarget(_);else if(le.__hasExternalTextures)ke.rebindTextures(_,Le.get(_.texture).__webglTexture,Le.get(_.depthTexture).__webglTexture);else if(_.depthBuffer){let ze=_.depthTexture;if(le.__boundDepthTexture!==ze){if(ze!==null&&Le.has(ze)&&(_.width!==ze.image.width||_.height!==ze.image.height))throw new Error("THREE.WebGLRenderer: Attached DepthTexture is initialized to the incorrect size.");ke.setupDepthRenderbuffer(_)}}let xe=_.texture;(xe.isData3DTexture||xe.isDataArrayTexture||xe.isCompressedArrayTexture)&&(he=!0);let Ae=Le.get(_).__webglFramebuffer;_.isWebGLCubeRenderTarget?(Array.isArray(Ae[L])?U=Ae[L][z]:U=Ae[L],B=!0):_.samples>0&&ke.useMultisampledRTT(_)===!1?U=Le.get(_).__webglMultisampledFramebuffer:Array.isArray(Ae)?U=Ae[z]:U=Ae,Q.copy(_.viewport),Te.copy(_.scissor),Be=_.scissorTest}else Q.copy(Ne).multiplyScalar(ge).floor(),Te.copy(st).multiplyScalar(ge).floor(),Be=ct;if(z!==0&&(U=V),de.bindFramebuffer(D.FRAMEBUFFER,U)&&de.drawBuffers(_,U),de.viewport(Q),de.scissor(Te),de.setScissorTest(Be),B){let le=Le.get(_.texture);D.framebufferTexture2D(D.FRAMEBUFFER,D.COLOR_ATTACHMENT0,D.TEXTURE_CUBE_MAP_POSITIVE_X+L,le.__webglTexture,z)}else if(he){let le=L;for(let xe=0;xe<_.textures.length;xe++){let Ae=Le.get(_.textures[xe]);D.framebufferTextureLayer(D.FRAMEBUFFER,D.COLOR_ATTACHMENT0+xe,Ae.__webglTexture,z,le)}}else if(_!==null&&z!==0){let le=Le.get(_.texture);D.framebufferTexture2D(D.FRAMEBUFFER,D.COLOR_ATTACHMENT0,D.TEXTURE_2D,le.__webglTexture,z)}X=-1};function Xd(_){let L=Le.get(_);return(L.__readFormat!==_.format||L.__readType!==_.type)&&(L.__readFormat=_.format,L.__readType=_.type,L.__formatReadable=mt.textureFormatReadable(_.format),L.__typeReadable=mt.textureTypeReadable(_.type)),L}this.readRenderTargetPixels=function(_,L,z,U,B,he,be,le=0){if(!(_&&_.isWebGLRenderTarget)){Oe("WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");return}let xe=Le.get(_).__webglFramebuffer;if(_.isWebGLCubeRenderTarget&&be!==void 0&&(xe=xe[be],Array.isArray(xe)&&(xe=xe[0])),xe){de.bindFramebuffer(D.FRAMEBUFFER,xe);try{let Ae=_.textures[le],ze=Ae.format,je=Ae.type;_.textures.length>1&&D.readBuffer(D.COLOR_ATTACHMENT0+le);let we=Xd(Ae);if(we.__formatReadable===!1){Oe("WebGLRenderer.readRenderTargetPixels: renderTarget is not in RGBA or implementation defined format.");return}if(we.__typeReadable===!1){Oe("WebGLRenderer.readRenderTargetPixels: renderTarget is not in UnsignedByteType or implementation defined type.");return}L>=0&&L<=_.width-U&&z>=0&&z<=_.height-B&&D.readPixels(L,z,U,B,ie.convert(ze),ie.convert(je),he)}finally{let Ae=te!==null?Le.get(te).__webglFramebuffer:null;de.bindFramebuffer(D.FRAMEBUFFER,Ae)}}},this.readRenderTargetPixelsAsync=async function(_,L,z,U,B,he,be,le=0){if(!(_&&_.isWebGLRenderTarget))throw new Error("THREE.WebGLRenderer.readRenderTargetPixels: renderTarget is not THREE.WebGLRenderTarget.");let xe=Le.get(_).__webglFramebuffer;if(_.isWebGLCubeRenderTarget&&be!==void 0&&(xe=xe[be],Array.isArray(xe)&&(xe=xe[0])),xe)if(L>=0&&L<=_.width-U&&z>=0&&z<=_.height-B){de.bindFramebuffer(D.FRAMEBUFFER,xe);let Ae=_.textures[le],ze=Ae.format,je=Ae.type;_.textures.length>1&&D.readBuffer(D.COLOR_ATTACHMENT0+le);let we=Xd(Ae);if(we.__formatReadable===!1)throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in RGBA or implementation defined format.");if(we.__typeReadable===!1)throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: renderTarget is not in UnsignedByteType or implementation defined type.");let Ze=D.createBuffer();D.bindBuffer(D.PIXEL_PACK_BUFFER,Ze),D.bufferData(D.PIXEL_PACK_BUFFER,he.byteLength,D.STREAM_READ),D.readPixels(L,z,U,B,ie.convert(ze),ie.convert(je),0),D.bindBuffer(D.PIXEL_PACK_BUFFER,null);let Ct=te!==null?Le.get(te).__webglFramebuffer:null;de.bindFramebuffer(D.FRAMEBUFFER,Ct);let ft=D.fenceSync(D.SYNC_GPU_COMMANDS_COMPLETE,0);return D.flush(),await _p(D,ft,4),D.bindBuffer(D.PIXEL_PACK_BUFFER,Ze),D.getBufferSubData(D.PIXEL_PACK_BUFFER,0,he),D.bindBuffer(D.PIXEL_PACK_BUFFER,null),D.deleteBuffer(Ze),D.deleteSync(ft),he}else throw new Error("THREE.WebGLRenderer.readRenderTargetPixelsAsync: requested read bounds are out of range.")},this.copyFramebufferToTexture=function(_,L=null,z=0){let U=Math.pow(2,-z),B=Math.floor(_.image.width*U),he=Math.floor(_.image.height*U),be=L!==null?L.x:0,le=L!==null?L.y:0;ke.setTexture2D(_,0),D.copyTexSubImage2D(D.TEXTURE_2D,z,0,0,be,le,B,he),de.unbindTexture()},this.copyTextureToTexture=function(_,L,z=null,U=null,B=0,he=0){let be,le,xe,Ae,ze,je,we,Ze,Ct,ft=_.isCompressedTexture?_.mipmaps[he]:_.image;if(z!==null)be=z.max.x-z.min.x,le=z.max.y-z.min.y,xe=z.isBox3?z.max.z-z.min.z:1,Ae=z.min.x,ze=z.min.y,je=z.isBox3?z.min.z:0;else{let Je=Math.pow(2,-B);be=Math.floor(ft.width*Je),le=Math.floor(ft.height*Je),_.isDataArrayTexture?xe=ft.depth:_.isData3DTexture?xe=Math.floor(ft.depth*Je):xe=1,Ae=0,ze=0,je=0}U!==null?(we=U.x,Ze=U.y,Ct=U.z):(we=0,Ze=0,Ct=0);let ht=ie.convert(L.format),Zt=ie.convert(L.type),Se;L.isData3DTexture?(ke.setTexture3D(L,0),Se=D.TEXTURE_3D):L.isDataArrayTexture||L.isCompressedArrayTexture?(ke.setTexture2DArray(L,0),Se=D.TEXTURE_2D_ARRAY):(ke.setTexture2D(L,0),Se=D.TEXTURE_2D),de.activeTexture(D.TEXTURE0),de.pixelStorei(D.UNPACK_FLIP_Y_WEBGL,L.flipY),de.pixelStorei(D.UNPACK_PREMULTIPLY_ALPHA_WEBGL,L.premultiplyAlpha),de.pixelStorei(D.UNPACK_ALIGNMENT,L.unpackAlignment);let rn=de.getParameter(D.UNPACK_ROW_LENGTH),et=de.getParameter(D.UNPACK_IMAGE_HEIGHT),ss=de.getParameter(D.UNPACK_SKIP_PIXELS),Jt=de.getParameter(D.UNPACK_SKIP_ROWS),Yo=de.getParameter(D.UNPACK_SKIP_IMAGES);de.pixelStorei(D.UNPACK_ROW_LENGTH,ft.width),de.pixelStorei(D.UNPACK_IMAGE_HEIGHT,ft.height),de.pixelStorei(D.UNPACK_SKIP_PIXELS,Ae),de.pixelStorei(D.UNPACK_SKIP_ROWS,ze),de.pixelStorei(D.UNPACK_SKIP_IMAGES,je);let Di=_.isDataArrayTexture||_.isData3DTexture,rs=L.isDataArrayTexture||L.isData3DTexture;if(_.isDepthTexture){let Je=Le.get(_),qt=Le.get(L),On=Le.get(Je.__renderTarget),yt=Le.get(qt.__renderTarget);de.bindFramebuffer(D.READ_FRAMEBUFFER,On.__webglFramebuffer),de.bindFramebuffer(D.DRAW_FRAMEBUFFER,yt.__webglFramebuffer);for(let Ht=0;Ht<xe;Ht++)Di&&(D.framebufferTextureLayer(D.READ_FRAMEBUFFER,D.COLOR_ATTACHMENT0,Le.get(_).__webglTexture,B,je+Ht),D.framebufferTextureLayer(D.DRAW_FRAMEBUFFER,D.COLOR_ATTACHMENT0,Le.get(L).__webglTexture,he,Ct+Ht)),D.blitFramebuffer(Ae,ze,Ae+be,ze+le,we,Ze,we+be,Ze+le,D.DEPTH_BUFFER_BIT,D.NEAREST);de.bindFramebuffer(D.READ_FRAMEBUFFER,null),de.bindFramebuffer(D.DRAW_FRAMEBUFFER,null)}else if(B!==0||_.isRenderTargetTexture||Le.has(_)){let Je=Le.get(_),qt=Le.get(L);de.bindFramebuffer(D.READ_FRAMEBUFFER,P),de.bindFramebuffer(D.DRAW_FRAMEBUFFER,G);for(let On=0;On<xe;On++)Di?D.framebufferTextureLayer(D.READ_FRAMEBUFFER,D.COLOR_ATTACHMENT0,Je.__webglTexture,B,je+On):D.framebufferTexture2D(D.READ_FRAMEBUFFER,D.COLOR_ATTACHMENT0,D.TEXTURE_2D,Je.__webglTexture,B),rs?D.framebufferTextureLayer(D.DRAW_FRAMEBUFFER,D.COLOR_ATTACHMENT0,qt.__webglTexture,he,Ct+On):D.framebufferTexture2D(D.DRAW_FRAMEBUFFER,D.COLOR_ATTACHMENT0,D.TEXTURE_2D,qt.__webglTexture,he),B!==0?D.blitFramebuffer(Ae,ze,Ae+be,ze+le,we,Ze,we+be,Ze+le,D.COLOR_BUFFER_BIT,D.NEAREST):rs?D.copyTexSubImage3D(Se,he,we,Ze,Ct+On,Ae,ze,be,le):D.copyTexSubImage2D(Se,he,we,Ze,Ae,ze,be,le);de.bindFramebuffer(D.READ_FRAMEBUFFER,null),de.bindFramebuffer(D.DRAW_FRAMEBUFFER,null)}else rs?_.isDataTexture||_.isData3DTexture?D.texSubImage3D(Se,he,we,Ze,Ct,be,le,xe,ht,Zt,ft.data):L.isCompressedArrayTexture?D.compressedTexSubImage3D(Se,he,we,Ze,Ct,be,le,xe,ht,ft.data):D.texSubImage3D(Se,he,we,Ze,Ct,be,le,xe,ht,Zt,ft):_.isDataTexture?D.texSubImage2D(D.TEXTURE_2D,he,we,Ze,be,le,ht,Zt,ft.data):_.isCompressedTexture?D.compressedTexSubImage2D(D.TEXTURE_2D,he,we,Ze,ft.width,ft.height,ht,ft.data):D.texSubImage2D(D.TEXTURE_2D,he,we,Ze,be,le,ht,Zt,ft);de.pixelStorei(D.UNPACK_ROW_LENGTH,rn),de.pixelStorei(D.UNPACK_IMAGE_HEIGHT,et),de.pixelStorei(D.UNPACK_SKIP_PIXELS,ss),de.pixelStorei(D.UNPACK_SKIP_ROWS,Jt),de.pixelStorei(D.UNPACK_SKIP_IMAGES,Yo),he===0&&L.generateMipmaps===!0&&L.mipmapsAutoUpdate===!0&&D.generateMipmap(Se),de.unbindTexture()},this.initRenderTarget=function(_){Le.get(_).__webglFramebuffer===void 0&&ke.setupRenderTarget(_)},this.initTexture=function(_){_.isCubeTexture?ke.setTextureCube(_,0):_.isData3DTexture?ke.setTexture3D(_,0):_.isDataArrayTexture||_.isCompressedArrayTexture?ke.setTexture2DArray(_,0):ke.setTexture2D(_,0),de.unbindTexture()},this.resetState=function(){q=0,H=0,te=null,de.reset(),re.reset()},typeof __THREE_DEVTOOLS__<"u"&&__THREE_DEVTOOLS__.dispatchEvent(new CustomEvent("observe",{detail:this}))}get coordinateSystem(){return Pn}get outputColorSpace(){return this._outputColorSpace}set outputColorSpace(e){this._outputColorSpace=e;let t=this.getContext();t.drawingBufferColorSpace=Xe._getDrawingBufferColorSpace(e),t.unpackColorSpace=Xe._getUnpackColorSpace()}};var Wl=class{constructor(e){this.url=e;setInterval(()=>this.watch(),2e3)}url;line="connecting";roundTrip=NaN;frames=0;reconnects=0;onMessage=()=>{};onLine=()=>{};onFrame=()=>{};socket=null;newest=null;wait=250;heard=0;number=0;waiting=new Map;opened=!1;resume="";hurries=!1;open(){let e=new WebSocket(this.resume?`${this.url}?resume=${encodeURIComponent(this.resume)}`:this.url);e.binaryType="arraybuffer",this.socket=e,this.heard=performance.now(),e.onopen=()=>{this.opened=!0,this.wait=250,this.say("open")},e.onmessage=t=>{this.heard=performance.now(),typeof t.data!="string"?(this.newest=t.data,this.frames++,this.onFrame()):this.hear(JSON.parse(t.data))},e.onclose=()=>{this.socket===e&&this.lost()}}take(){let e=this.newest;return this.newest=null,e}ask(e,t={}){if(this.socket?.readyState!==WebSocket.OPEN)return Promise.resolve({ok:!1,code:"offline",message:"There is no connection to the server."});let n=++this.number;return this.socket.send(JSON.stringify({type:e,id:n,...t})),new Promise(i=>this.waiting.set(n,i))}tell(e,t){return this.socket?.readyState!==WebSocket.OPEN||this.socket.bufferedAmount>4096?!1:(this.socket.send(JSON.stringify({type:e,...t})),!0)}drop(){this.socket?.close()}hear(e){if(e.type==="hello"&&(this.resume=e.resume??""),e.type==="pong"&&(this.roundTrip=performance.now()-e.t),(e.type==="ack"||e.type==="error")&&e.id!==void 0){let t=this.waiting.get(e.id);this.waiting.delete(e.id),e.type==="ack"?t?.({ok:!0,code:"",message:""}):t?.({ok:!1,code:e.code,message:e.message})}this.onMessage(e)}watch(){if(this.socket?.readyState===WebSocket.OPEN)if(performance.now()-this.heard>8e3){let e=this.socket;this.lost(),e.close()}else this.tell("ping",{t:performance.now()})}lost(){this.socket=null;for(let t of this.waiting.values())t({ok:!1,code:"offline",message:"The connection to the server was lost."});this.waiting.clear(),this.reconnects++,this.say("reconnecting"),this.opened||this.admitted();let e=this.wait*(.8+.4*Math.random());setTimeout(()=>this.open(),e),this.wait=Math.min(2*this.wait,this.hurries?500:5e3)}async admitted(){try{let e=(await fetch("scene.json",{cache:"no-store"})).status;(e===401||e===403)&&this.line!=="open"&&this.say("refused")}catch{}}say(e){this.line!==e&&(this.line=e,this.onLine(e))}};var Qe=["right","left"],Kb=2,jb=30,Zb=.01,Jb=40*Math.PI/180,Qb=4,eM=4,rm=50,tM=5e3,nM=5*Math.PI/180,Xl=class{p=new S;q=new De;grip=0;at=new S;turned=new De;gripped=0;used=-1/0;shaken=-1;constructor(e){this.p.set(e,0,0),this.at.copy(this.p)}move(e,t,n){this.p.add(new S(e,t,n)),this.used=performance.now()}turn(e,t,n){let i=Math.hypot(e,t,n);i>0&&this.q.premultiply(new De().setFromAxisAngle(new S(e,t,n).divideScalar(i),i)),this.used=performance.now()}squeeze(e){this.grip=Jb*Math.min(1,Math.max(0,e)),this.used=performance.now()}shake(e){this.shaken=e,this.q.multiply(new De().setFromAxisAngle(new S(0,0,1),nM))}get rests(){return this.p.equals(this.at)&&this.q.angleTo(this.turned)<1e-6&&this.grip===this.gripped}rest(){this.p.copy(this.at),this.q.copy(this.turned)}next(e){let t=this.p.clone().sub(this.at),n=Math.min(e,Zb);this.at.add(t.clampLength(0,Kb*n)),this.turned.rotateTowards(this.q,jb*n).normalize();let i=this.grip-this.gripped;return this.gripped+=Math.sign(i)*Math.min(Math.abs(i),Qb*e),{pose:[...this.at.toArray(),...this.turned.toArray()],grip:this.gripped}}},ql=class{constructor(e,t,n,i=["clutch","camera"]){this.line=e;this.state=t;this.client=n;this.pedals=i;setInterval(()=>this.say(performance.now()),rm/2);let r=()=>this.drop();window.addEventListener("blur",r),document.addEventListener("visibilitychange",()=>document.hidden&&r())}line;state;client;pedals;right=new Xl(.08);left=new Xl(-.08);active=!1;lost=new Set;pressed={clutch:new Set,camera:new Set};number=0;said=-1/0;used=-1/0;refused=-1/0;first=0;begun=0;use(){this.used=performance.now(),this.active||(this.first=this.number,this.begun=this.used,this.right.shaken=this.left.shaken=-1),this.active=!0}get clutch(){return this.pressed.clutch.size>0}get camera(){return this.pressed.camera.size>0}press(e,t,n){if(!this.pedals.includes(e))return;let i=this.pressed[e],r=this[e];if(n)i.add(t);else if(!i.delete(t))return;if(this[e]!==r)for(let o of Qe)this[o].rest();this.use()}presses(e,t){return this.pressed[e].has(t)}drop(){if(this.pressed.clutch.clear(),this.pressed.camera.clear(),this.lost.clear(),!!this.active){this.active=!1;for(let e of Qe)this[e].rest();this.line.tell("release",{})}}get waits(){return performance.now()-this.refused<1e3}say(e){if(!this.active)return;let t=this.used>this.said||Qe.some(u=>!this[u].rests);if(e-this.said<(t?eM:rm))return;let n=this.state();if(n?.owner&&n.owner!==this.client()&&!n.silent){this.refused=e,this.active=!1;for(let u of Qe)this[u].rest();return}if(e-this.used>tM||n?.task?.over)return this.drop();if(this.lost.size)return;let r=n?.plan&&n.plan.phase!=="off"&&n.plan.phase!=="aim";if(n&&!r&&!n.silent&&n.mode==="instruments"&&n.owner===this.client())for(let u of Qe){let d=this[u];n.heard>=Math.max(this.first,d.shaken)&&n.hands[u]?.follows===!1&&d.used>=this.begun&&d.shake(this.number)}let o=Math.min(.1,(e-this.said)/1e3);this.said=e;let{clutch:a,camera:l}=this,[c,h]=[this.right.next(o),this.left.next(o)];this.line.tell("hands",{number:this.number++%2**32,right:c,left:h,clutch:a,camera:l})}};var iM=0,sM=1,rM=3,oM=4,aM=5,om=.015,lM=.07,am=["index","middle","ring","pinky"];function lm(s,e,t){return s.session.visibilityState&&s.session.visibilityState!=="visible"?null:t.hand?hM(s,e,t.hand):cM(s,e,t)}function cM(s,e,t){let n=t.gripSpace&&s.getPose(t.gripSpace,e),i=t.gamepad?.buttons;if(!n||n.emulatedPosition||!i)return null;let r=o=>i[o]?.pressed??!1;return{...Fu(n.transform),open:1-(i[iM]?.value??0),clutch:r(sM),camera:r(rM)||r(oM),plan:r(aM),fist:!1}}function hM(s,e,t){let n=y=>{let p=t.get(y);return(p&&s.getJointPose?.(p,e)?.transform)??null},i=y=>{let p=n(y);return p&&Fu(p).p},r=n("wrist"),[o,a]=[i("thumb-tip"),i("index-finger-tip")],l=am.map(y=>i(`${y}-finger-phalanx-proximal`)),c=am.map(y=>i(`${y}-finger-tip`)),h=l[0];if(!r||!o||!a||!h)return null;let{p:u,q:d}=Fu(r),f=c.every((y,p)=>{let m=l[p];return y&&m&&y.distanceTo(u)<m.distanceTo(u)}),g=Math.min(1,Math.max(0,(o.distanceTo(a)-om)/(lM-om)));return{p:h,q:d,open:g,clutch:!1,camera:!1,plan:!1,fist:f}}function Fu({position:s,orientation:e}){return{p:new S(s.x,s.y,s.z),q:new De(e.x,e.y,e.z,e.w)}}var cm=.2,uM=3,dM=20,hm=[.03,.5],fM=.1,pM=.05,mM=[.7,120],um=60,Yl=[["Begin","pull the trigger, or pinch"],["Instruments","move and turn the hands"],["Jaws","trigger, or thumb and index finger"],["Clutch","grip button, or one fist"],["Camera","A, X or the stick pushed in, or two fists"],["Plan a motion","hold B or Y and move the target, release; then use the panel"],["Panel","a hand that points at it moves no instrument"]],Kl=[["Begin","pull the trigger of the right controller, or pinch"],["Pedal: the robot follows","hold the grip button, or make a fist"],["Instrument","move and turn the right hand"],["Panel","a hand that points at it moves no instrument"]],$l=class{constructor(e,t){this.app=e;this.console=t}app;console;leading=new Set;last={right:null,left:null};mean={right:1,left:1};felt={right:!1,left:!1};pulsed={right:-1/0,left:-1/0};then=0;update(e,t,n){let i=Math.min(.2,(n-this.then)/1e3);this.then=n;let{pens:r}=this.console;r.active||this.forget();let o=[...e.session.inputSources].filter(c=>c.targetRayMode==="tracked-pointer"),a=c=>o.find(h=>h.handedness===c),l={right:null,left:null};for(let c of Qe){let h=a(c);l[c]=h?lm(e,t,h):null,this.leading.has(c)&&!l[c]?r.lost.add(c):r.lost.delete(c)}if(!r.lost.size){this.pedals(l);for(let c of Qe)this.lead(c,l[c],i)}for(let c of Qe)this.last[c]=l[c],this.feel(c,a(c)?.gamepad,n)}forget(){this.leading.clear(),this.console.pens.lost.clear(),this.console.plan.forget("headset");for(let e of["clutch","camera"])this.console.pens.presses(e,"headset")&&this.console.pens.press(e,"headset",!1)}pedals(e){let t=Qe.flatMap(o=>this.leading.has(o)?[e[o]]:[]),n=t.filter(o=>o?.fist).length,{pens:i}=this.console;i.press("clutch","headset",n===1||t.some(o=>o?.clutch));let r=Qe.find(o=>this.leading.has(o)&&e[o]?.plan);r&&(this.console.chosen=r),this.console.plan.press("headset",r!==void 0),i.press("camera","headset",n===2||t.some(o=>o?.camera))}lead(e,t,n){let i=this.last[e];if(!t||!i)return;let r=!this.leading.has(e);if(r||this.console.pens.use(),this.app.hands.usesPanel(e)||r&&(t.open>cm||i.open<=cm))return;let o=this.console.pens[e],a=Math.abs(t.open-this.mean[e])>fM;if(this.mean[e]+=(t.open-this.mean[e])*(1-Math.exp(-n/pM)),this.leading.add(e),this.console.pens.use(),this.console.chosen=e,t.fist||o.squeeze(t.open),r||a)return;let l=t.p.clone().sub(i.p),c=t.q.clone().multiply(i.q.clone().invert()).normalize();c.w<0&&c.set(-c.x,-c.y,-c.z,-c.w);let h=2*Math.acos(Math.min(1,c.w));if(l.length()>Math.max(hm[0],uM*n)||h>Math.max(hm[1],dM*n))return;let u=this.console.screen.turned(new De).invert();l.applyQuaternion(u),o.move(l.x,l.y,l.z);let d=new S(c.x,c.y,c.z);d.lengthSq()>1e-16&&(d.normalize().multiplyScalar(h).applyQuaternion(u),o.turn(d.x,d.y,d.z))}feel(e,t,n){let i=this.app.model.console,r=this.console.haptics&&this.leading.has(e)&&!!(i?.hands[e]?.wall||i?.camera),a=t?.hapticActuators?.[0],l=this.leading.has(e)?this.console.forces.strength(e):0;r&&!this.felt[e]?a?.pulse?.(...mM):l>0&&n-this.pulsed[e]>um&&(this.pulsed[e]=n,a?.pulse?.(l,um)),this.felt[e]=r}};var jl=class{constructor(e,t){this.app=e;this.console=t;let n=e.world.renderer.domElement;n.addEventListener("pointerdown",i=>this.down(i),{capture:!0}),n.addEventListener("pointermove",i=>this.move(i),{capture:!0}),n.addEventListener("pointerrawupdate",i=>this.move(i),{capture:!0}),n.addEventListener("pointerup",i=>this.up(i),{capture:!0}),n.addEventListener("pointercancel",i=>this.up(i),{capture:!0}),n.addEventListener("wheel",i=>this.wheel(i),{capture:!0,passive:!1}),n.addEventListener("contextmenu",i=>i.preventDefault())}app;console;pointer=null;side="right";last={x:0,y:0};works(e){return e.pointerType!=="touch"&&this.console.works(e.clientX,e.clientY)}down(e){if(!this.works(e)||(e.stopImmediatePropagation(),this.pointer!==null))return;let t=this.app.world.renderer.domElement;t.focus(),this.pointer=e.pointerId,t.setPointerCapture(e.pointerId),this.side=this.console.nearest(e.clientX,e.clientY),this.console.chosen=this.side,this.console.pens.use(),e.button===2&&this.console.pens.press("camera","mouse",!0),this.console.enable("mouse",!0),this.last={x:e.clientX,y:e.clientY},t.style.cursor="grabbing"}move(e){let t=this.app.world.renderer.domElement;if(this.pointer===null&&(t.style.cursor=this.works(e)?"crosshair":""),e.pointerId!==this.pointer)return;e.stopImmediatePropagation();let[n,i]=[e.clientX-this.last.x,e.clientY-this.last.y];if(!n&&!i)return;this.last={x:e.clientX,y:e.clientY};let{console:r,side:o}=this;e.shiftKey?r.turn(o,.008*i,.008*n,0):r.move(o,r.perPixel*n,-r.perPixel*i,0),r.pens.say(performance.now())}wheel(e){if(!this.works(e))return;e.preventDefault(),e.stopImmediatePropagation();let t=Math.sign(e.deltaY||e.deltaX),n=this.pointer===null?this.console.nearest(e.clientX,e.clientY):this.side;this.console.notch(n,e.shiftKey,t,.006,.12)}up(e){e.pointerId===this.pointer&&(e.stopImmediatePropagation(),this.pointer=null,this.console.pens.press("camera","mouse",!1),this.console.enable("mouse",!1),this.app.world.renderer.domElement.style.cursor="")}};var Zl=class{constructor(e,t){this.app=e;this.console=t;let n=e.world.renderer.domElement,i={capture:!0};n.addEventListener("pointerdown",r=>this.down(r),i),n.addEventListener("pointermove",r=>this.move(r),i),n.addEventListener("pointerup",r=>this.up(r),i),n.addEventListener("pointercancel",r=>this.up(r),i)}app;console;fingers=new Map;side="right";doing="nothing";begun={x:0,y:0};down(e){if(e.pointerType!=="touch"||!this.console.works(e.clientX,e.clientY))return;e.stopImmediatePropagation();let{console:t}=this;this.app.world.renderer.domElement.setPointerCapture(e.pointerId),this.fingers.set(e.pointerId,{x:e.clientX,y:e.clientY}),this.fingers.size===1?(this.begun={x:e.clientX,y:e.clientY},this.side=t.nearest(e.clientX,e.clientY),this.doing="waiting"):this.fingers.size===2&&(this.doing="camera",t.pens.press("camera","touch",!0)),t.chosen=this.side,t.enable("touch",!0),t.pens.use()}move(e){let t=this.fingers.get(e.pointerId);if(!t)return;e.stopImmediatePropagation();let{console:n}=this,i={x:e.clientX,y:e.clientY};if(this.doing==="waiting"){if(Math.hypot(i.x-this.begun.x,i.y-this.begun.y)<8)return;this.doing="instrument"}let[r,o]=[...this.fingers.keys()],a=this.fingers.get(e.pointerId===r?o:r);this.fingers.set(e.pointerId,i);let[l,c]=[i.x-t.x,i.y-t.y];if(this.doing==="instrument"&&n.move(this.side,n.perPixel*l,-n.perPixel*c,0),this.doing!=="camera"||!a||![r,o].includes(e.pointerId))return;n.move(this.side,n.perPixel*l/2,-n.perPixel*c/2,0);let[h,u]=[dm(a,t),dm(a,i)];if(h.length<1||u.length<1)return;n.zoom(u.length/h.length);let d=h.angle-u.angle;n.turn(this.side,0,0,Math.atan2(Math.sin(d),Math.cos(d)))}up(e){this.fingers.delete(e.pointerId)&&(e.stopImmediatePropagation(),this.doing="nothing",this.console.pens.press("camera","touch",!1),this.console.enable("touch",!1))}};function dm(s,e){return{length:Math.hypot(e.x-s.x,e.y-s.y),angle:Math.atan2(e.y-s.y,e.x-s.x)}}var gM=3.3,fm=.05,xM=.006,pm=.005,yM=3014543,vM=new S(0,1,0),Jl=class{constructor(e,t){this.app=e;this.console=t;this.arrows={right:this.arrow(),left:this.arrow()}}app;console;now={right:new S,left:new S};arrows;hear(e){for(let t of Qe)this.now[t].fromArray(e[t]);this.app.world.dirty=!0}strength(e){let t=this.now[e].length();return t<fm?0:Math.min(1,t/gM)}update(){let{scope:e}=this.console.views,t=e.getWorldQuaternion(new De),n=e.matrixWorld.getMaxScaleOnAxis();for(let i of Qe){let[r,o,a]=[this.arrows[i],this.now[i],this.console.tip(i)];if(r.visible=a!==null&&o.length()>=fm,!r.visible||!a)continue;let l=xM*o.length();r.position.copy(a),r.quaternion.setFromUnitVectors(vM,o.clone().normalize().applyQuaternion(t)),r.scale.setScalar(n);let[c,h]=r.children;c.scale.y=l,h.position.y=l}}text(){return this.app.model.console?.haptics?`Forces: ${Qe.toReversed().map(t=>`${t} ${this.now[t].length().toFixed(1)} N`).join(", ")}`:"Forces: off"}arrow(){let e=new Pe,t=new lt({color:yM,depthTest:!1,transparent:!0}),n=new ue(new tn(6e-4,6e-4,1).translate(0,.5,0),t),i=new ue(new fr(.0018,pm).translate(0,pm/2,0),t);e.add(n,i);for(let r of e.children)r.renderOrder=10;return e.visible=!1,this.app.world.scene.add(e),e}};var mn=(s,e="",t="")=>{let n=document.createElement(s);return e&&(n.className=e),t&&(n.textContent=t),n};var Ql=class{constructor(e,t,n){this.app=t;this.asked=n;this.card.dataset.id="form",this.card.hidden=!0,this.card.onsubmit=i=>{i.preventDefault(),this.send()},this.card.addEventListener("keydown",i=>i.stopPropagation()),e.append(this.card)}app;asked;card=mn("form","card form");shown="";when="";answers=[];wrong="";sending=!1;left=0;inHeadset=!1;pairs=[];refresh(){let e=this.app.model.console?.form??null,t=JSON.stringify(e),n=this.key;if(t!==this.shown){this.shown=t,this.card.hidden=!e||!n,e&&n&&(this.begin(n,e.when,e.left),this.build(n));let i=this.tab();this.app.showPanel(i),i&&this.app.xrPanel.choose(i.id)}this.inHeadset&&!this.app.xr.presenting&&n&&this.build(n),this.inHeadset=this.app.xr.presenting}get due(){return this.key?`Answer the questionnaire ${this.app.xr.presenting?"on the panel":"on the page"}: the hands are at rest until then.`:null}get key(){return this.asked.find(e=>e.name===this.app.model.console?.form?.name)}begin(e,t,n){if(this.when=t,this.left=n,this.wrong="",this.sending=!1,this.answers=e.items.map(()=>null),this.pairs=[],e.pairs)for(let i=0;i<e.items.length;i++)for(let r=i+1;r<e.items.length;r++)this.pairs.push({items:[i,r],chosen:null})}headText(e){let t=this.left>1?`, ${this.left-1} more`:"";return`${this.when==="before"?"Before":"After"} the task${t}. From ${e.ends[0]} to ${e.ends[1]}.`}values(e){let t=Math.round((e.high-e.low)/e.step)+1;return t<=7?Array.from({length:t},(n,i)=>e.low+i*e.step):null}build(e){let t=[mn("h2","",e.title),mn("p","",this.headText(e))];e.items.forEach((i,r)=>t.push(this.item(e,i,r))),e.pairs&&t.push(this.comparisons(e));let n=mn("button","enter","Done");n.dataset.id="form-done",n.disabled=this.sending,t.push(mn("p","wrong",this.wrong),n),this.card.replaceChildren(...t)}item(e,t,n){let i=mn("fieldset");i.append(mn("legend","",t));let r=this.answers[n]??null,o=this.values(e);if(o){for(let h of o)i.append(this.choice(`item-${n}`,String(h),h===r,()=>this.answers[n]=h));return i}let a=mn("input"),l=r??(e.low+e.high)/2;Object.assign(a,{type:"range",min:String(e.low),max:String(e.high),step:String(e.step),value:String(l)}),a.setAttribute("aria-label",t),a.dataset.id=`item-${n}`;let c=mn("output","",r===null?"\u2013":String(r));return a.oninput=()=>{this.answers[n]=Number(a.value),c.textContent=a.value},i.append(a,c),i}comparisons(e){let t=mn("details");return t.append(mn("summary","",this.weightsText)),this.pairs.forEach((n,i)=>{let r=mn("fieldset");for(let o of n.items)r.append(this.choice(`pair-${i}`,e.items[o],n.chosen===o,()=>n.chosen=o));t.append(r)}),t}get weightsText(){return`Weights: in each of ${this.pairs.length} pairs, choose what counted more (all or none)`}choice(e,t,n,i){let r=mn("label"),o=mn("input");return Object.assign(o,{type:"radio",name:e,value:t,checked:n}),o.onchange=i,r.append(o,t),r}send(){let{key:e,when:t}=this;if(!e||!t||this.sending)return;let n=this.pairs.filter(r=>r.chosen!==null).length;if(n>0&&n<this.pairs.length){this.say(`${this.pairs.length-n} of ${this.pairs.length} pairs are not compared yet: compare all or none.`);return}this.say("");let i=n?e.items.map((r,o)=>this.pairs.filter(a=>a.chosen===o).length):null;this.wait(!0),this.app.ask("form",{when:t,name:e.name,answers:this.answers,weights:i}).then(r=>{r||this.wait(!1)})}say(e){this.wrong=e,this.card.querySelector(".wrong").textContent=e}wait(e){this.sending=e;let t=this.card.querySelector("[data-id=form-done]");t&&(t.disabled=e)}tab(){let{key:e}=this;if(!e)return null;let t=[{kind:"head",text:e.title},{kind:"text",id:"form-head",text:()=>this.headText(e)},...e.items.map((n,i)=>this.itemControl(e,n,i))];return this.pairs.length&&t.push({kind:"text",id:"form-weights",text:()=>this.weightsText}),this.pairs.forEach((n,i)=>t.push({kind:"row",items:n.items.map((r,o)=>({kind:"button",id:`pair-${i}-${o}`,label:()=>e.items[r],hint:"The item that mattered more",on:()=>n.chosen===r,press:()=>n.chosen=r}))})),t.push({kind:"text",id:"form-wrong",text:()=>this.wrong,tone:()=>"bad"},{kind:"button",id:"form-done",label:()=>"Done",hint:"Send the answers",off:()=>this.sending,press:()=>this.send()}),{id:"form",label:"Questionnaire",hint:"Questions that are asked now",controls:t}}itemControl(e,t,n){let i=`item-${n}`,r=()=>this.answers[n]??null,o=this.values(e);return o?{kind:"choice",id:i,label:t,hint:`${e.ends[0]} \u2026 ${e.ends[1]}`,options:()=>[["","\u2013"],...o.map(a=>[String(a),String(a)])],get:()=>String(r()??""),set:a=>this.answers[n]=a===""?null:Number(a)}:{kind:"slider",id:i,label:t,hint:`${e.ends[0]} \u2026 ${e.ends[1]}`,range:()=>[e.low,e.high],get:()=>r()??(e.low+e.high)/2,set:a=>this.answers[n]=e.low+e.step*Math.round((a-e.low)/e.step),show:()=>String(r()??"\u2013")}}};var mm={KeyW:["left",0,1,0],KeyS:["left",0,-1,0],KeyA:["left",-1,0,0],KeyD:["left",1,0,0],KeyQ:["left",0,0,-1],KeyE:["left",0,0,1],KeyI:["right",0,1,0],KeyK:["right",0,-1,0],KeyJ:["right",-1,0,0],KeyL:["right",1,0,0],KeyU:["right",0,0,-1],KeyO:["right",0,0,1]},ec={Space:"clutch",KeyC:"camera"},ku="KeyP",gm={KeyF:"left",KeyH:"right"},xm=[["Left instrument","W A S D, depth Q E"],["Right instrument","I J K L, depth U O"],["Open or close the jaws","left F, right H"],["Rotate","Shift with the keys of an instrument"],["Camera","hold C with the keys of an instrument"],["Clutch (instruments at rest)","hold Space"],["Motion scale","\u2013 and +"],["Forces on or off","T"],["Plan a motion","hold P and move the target, release; Enter accepts, Escape cancels"],["Swap the pictures","V"],["Fulcrum: control the tips or the outer ends","G"]],ym=[["Pedal: the robot follows","hold Space"],["Instrument","I J K L, depth U O"],["Rotate","Shift with these keys"],["Motion scale","\u2013 and +"],["Forces on or off","T"],["Swap the pictures","V"]],tc=class{constructor(e){this.console=e;window.addEventListener("keydown",t=>this.press(t)),window.addEventListener("keyup",t=>this.lift(t)),window.addEventListener("blur",()=>{this.down.clear(),this.console.plan.forget("keys")})}console;down=new Set;shift=!1;last=0;update(e){let t=Math.min(.1,(e-this.last)/1e3);this.last=e;for(let n of this.down){let i=mm[n];if(!i)continue;let[r,o,a,l]=i,c=this.console.sides.includes(r)?r:"right",[h,u]=[.06*t,1.2*t];this.shift?this.console.turn(c,-u*a,u*o,u*l):this.console.move(c,h*o,h*a,h*l)}}press(e){let t=e.target instanceof HTMLSelectElement,n=document.querySelector("dialog[open]")!==null;if(t||n||e.ctrlKey||e.metaKey||e.altKey)return;this.shift=e.shiftKey;let{console:i}=this;if(ec[e.code])i.pens.press(ec[e.code],"keys",!0);else if(e.key==="+"||e.key==="=")i.setScale(i.scale+.05);else if(e.key==="-")i.setScale(i.scale-.05);else{if(e.code===ku&&i.enables)return;if(e.code===ku)i.plan.press("keys",!0);else if(e.code==="Enter"&&i.plan.phase==="preview"&&!_M(e))i.plan.accept();else if(e.code==="Escape"&&i.plan.phase!=="off")i.plan.cancel();else if(e.code==="KeyT"&&!e.repeat)i.toggleHaptics();else if(e.code==="KeyG"&&!e.repeat)i.toggleFulcrum();else if(e.code==="KeyV"&&!e.repeat)i.views.swap();else if(gm[e.code]&&!e.repeat)i.toggleJaw(gm[e.code]);else if(mm[e.code])this.down.add(e.code);else return}e.preventDefault()}lift(e){this.shift=e.shiftKey,this.down.delete(e.code),e.code===ku&&this.console.plan.press("keys",!1),ec[e.code]&&this.console.pens.press(ec[e.code],"keys",!1)}},_M=s=>s.target instanceof HTMLButtonElement;var Qi=44,sn=class{sprite;canvas=document.createElement("canvas");texture=new bi(this.canvas);shown="";height=.03;constructor(){this.texture.colorSpace=ot,this.sprite=new to(new hr({map:this.texture,depthTest:!1,transparent:!0,toneMapped:!1})),this.sprite.center.set(0,0),this.sprite.renderOrder=9,this.sprite.visible=!1}say(e,t,n,i){let r=`${e}|${t}|${n}|${i}`;if(r===this.shown)return;this.shown=r,this.height=i;let o=e.split(`
`),a=this.canvas.getContext("2d"),l=`600 ${Qi}px system-ui, sans-serif`;a.font=l;let c=Math.ceil(Math.max(...o.map(d=>a.measureText(d).width))+Qi),h=Math.ceil(o.length*Qi*1.3+Qi*.5);(this.canvas.width!==c||this.canvas.height!==h)&&(this.canvas.width=c,this.canvas.height=h,this.texture.dispose()),a.font=l,a.clearRect(0,0,c,h),a.fillStyle=n==="additive"?"#e8f1ff":"#ffffffee",a.beginPath(),a.roundRect(2,2,c-4,h-4,Qi*.3),a.fill(),a.lineWidth=3,a.strokeStyle=t,a.stroke(),a.fillStyle=t,a.textBaseline="middle",o.forEach((d,f)=>a.fillText(d,Qi/2,Qi*(.9+1.3*f))),this.texture.needsUpdate=!0;let u=this.height/(Qi*1.3);this.sprite.scale.set(c*u,h*u,1)}};var Bu=.15,bM=.08,vm=80,_m=.2,MM=.5,wM=.5,SM=1.5,bm={left:0,right:2},zu={left:6,right:7},TM={left:10,right:11},AM={left:12,right:3},EM={left:13,right:0},Mm={left:14,right:2},RM=1,wm=8,Sm=9,CM=4,Tm=5,Am=[["Instruments","left and right stick"],["Rotate","press the stick"],["Depth","left: direction pad up, down; right: Y, A"],["Jaws, energy","triggers: pull to open, or to switch on"],["Next tool","left: direction pad left; right: X"],["Clutch, camera","left, right bumper"],["Plan a motion","hold B and move the target, release; Menu accepts, View cancels"]],Em=[["Pedal: the robot follows","hold a bumper"],["Instrument","right stick"],["Depth","right trigger deeper, left trigger back; or Y and A"],["Rotate","left stick"]],ic=class{constructor(e){this.console=e}console;name="";last=0;pulled={right:0,left:0};depth={right:0,left:0};next={right:!1,left:!1};decides={cancel:!1,accept:!1};walls=0;felt=-1/0;update(e){let t=Math.min(.1,(e-this.last)/1e3);this.last=e;let n=navigator.getGamepads().find(a=>a?.connected&&a.mapping==="standard");if(!n&&this.name&&this.lost(),this.name=n?.id??"",!n)return;let i=a=>n.buttons[a]?.pressed??!1,r=a=>n.buttons[a]?.value??0,{console:o}=this;o.pens.press("clutch","pad",i(CM)||o.enables&&i(Tm)),o.pens.press("camera","pad",i(Tm)),o.enables||o.plan.press("pad",i(RM)),i(wm)&&!this.decides.cancel&&o.plan.cancel(),i(Sm)&&!this.decides.accept&&o.plan.accept(),this.decides={cancel:i(wm),accept:i(Sm)};for(let a of Qe){let l=!o.sides.includes(a),[c,h]=[nc(n.axes[bm[a]]),-nc(n.axes[bm[a]+1])],u=Number(i(EM[a]))-Number(i(AM[a]));this.depth[a]=u?Math.min(1,(this.depth[a]||_m)+t*(1-_m)/MM):0;let d=u*this.depth[a];o.enables&&!l&&(d+=nc(r(zu.left))-nc(r(zu.right)));let[f,g]=[bM*t,SM*t];if((c||h||d)&&(l&&d?o.move("right",0,0,f*d):l?o.turn("right",-g*h,g*c,0):i(TM[a])?o.turn(a,-g*h,g*c,g*d):o.move(a,f*c,f*h,f*d)),l||o.enables)continue;i(Mm[a])&&!this.next[a]&&o.nextTool(a),this.next[a]=i(Mm[a]);let y=r(zu[a]);Math.abs(y-this.pulled[a])>.02&&(this.pulled[a]=y,o.squeeze(a,y))}this.rumble(n,e)}lost(){let{pens:e}=this.console;for(let t of["clutch","camera"])e.presses(t,"pad")&&e.press(t,"pad",!1);this.console.plan.forget("pad");for(let t of Qe)e[t].rest();this.console.say("The gamepad was disconnected: the instruments stop, and the jaws stay as they are.")}rumble(e,t){let{console:n}=this,i=n.walls(),r=n.sound.buzzing?wM:0,o=Math.max(r,...Qe.map(a=>n.forces.strength(a)));i>this.walls&&n.haptics?e.vibrationActuator?.playEffect("dual-rumble",{duration:150,strongMagnitude:.8,weakMagnitude:.4}):o>0&&t-this.felt>vm&&(this.felt=t,e.vibrationActuator?.playEffect("dual-rumble",{duration:1.5*vm,strongMagnitude:o,weakMagnitude:o/2})),this.walls=i}};function nc(s){let e=Math.abs(s??0);return e<Bu?0:Math.sign(s)*(e-Bu)/(1-Bu)}function Rm(s,e){return e!==null&&s.flags===e.flags&&s.clipTime===e.clipTime&&No(s.body,e.body)}function No(s,e){return e!==void 0&&s.length===e.length&&s.every((t,n)=>t===e[n])}function Cm(s){let e=new DataView(s);if(s.byteLength<32)throw new Error(`a frame of ${s.byteLength} bytes has no complete header`);if(e.getUint32(0,!0)!==843994964){let i=Rr(s);return{seq:i.seq,time:i.clipTime,robots:[i],fields:[]}}let t={seq:e.getUint32(4,!0),time:e.getFloat64(16,!0),robots:[],fields:[]},n=32;for(let i=e.getUint16(24,!0);i>0;i--){let r=n+Pm(s,n);t.robots.push(Rr(s,n,r)),n=r}for(let i=e.getUint16(26,!0);i>0;i--){if(s.byteLength<n+28)throw new Error(`a frame of ${s.byteLength} bytes has no complete field at byte ${n}`);let r=e.getUint32(n,!0),o=n+28+4*Math.ceil(6*r/4);if(s.byteLength<o)throw new Error(`a frame of ${s.byteLength} bytes is truncated: a field ends at byte ${o}`);t.fields.push({low:new Float32Array(s,n+4,3),step:new Float32Array(s,n+16,3),levels:new Uint16Array(s,n+28,3*r),body:new Uint8Array(s,n,o-n)}),n=o}if(n!==s.byteLength)throw new Error(`a frame of ${s.byteLength} bytes, ${n} expected`);return t}function Rr(s,e=0,t=s.byteLength){let n=Pm(s,e);if(t-e!==n||t>s.byteLength)throw new Error(`a frame of ${s.byteLength-e} bytes, ${n} expected`);let i=new DataView(s,e),r=i.getUint16(24,!0),o=i.getUint16(26,!0),a=i.getUint32(28,!0),l=new Float32Array(s,e+32,(n-32)/4);return{seq:i.getUint32(4,!0),serverTime:i.getFloat64(8,!0),clipTime:i.getFloat64(16,!0),flags:a,poses:l.subarray(0,7*r),q:l.subarray(7*r,7*r+o),ghost:a&1?l.subarray(7*r+o):null,body:new Uint8Array(s,e+32,n-32)}}function Pm(s,e){if(s.byteLength-e<32)throw new Error(`a frame of ${s.byteLength-e} bytes has no complete header`);let t=new DataView(s,e);if(t.getUint32(0,!0)!==827217748)throw new Error("a frame does not begin with TWN1");let n=(t.getUint32(28,!0)&1)!==0;return 32+4*(7*t.getUint16(24,!0)+t.getUint16(26,!0)+(n?7:0))}var Cs=256,Im=.07,Lm=.4,PM=26,Dm=70,Nm=2.2,IM=420,Rs=null;function Cr(){if(Rs)return Rs;let s=document.createElement("canvas");s.width=s.height=Cs;let e=s.getContext("2d");if(e){let t=NM(7);e.fillStyle="#f4e9e4",e.fillRect(0,0,Cs,Cs);for(let n=0;n<IM;n++)LM(e,t);for(let n=0;n<PM;n++)DM(e,t)}return Rs=new bi(s),Rs.wrapS=Rs.wrapT=Hi,Rs.colorSpace=ot,Rs}function Pr(s){let e=s.getAttribute("position"),t=new Float32Array(2*e.count);for(let n=0;n<e.count;n++)t[2*n]=(e.getX(n)+Lm*e.getZ(n))/Im,t[2*n+1]=(e.getY(n)-Lm*e.getZ(n))/Im;s.setAttribute("uv",new bt(t,2))}function LM(s,e){let[t,n,i]=[Cs*e(),Cs*e(),4+20*e()**2],r=e()<.6,o=s.createRadialGradient(t,n,0,t,n,i);o.addColorStop(0,r?"#a04a4430":"#fff8f038"),o.addColorStop(1,r?"#a04a4400":"#fff8f000"),s.fillStyle=o,s.fillRect(t-i,n-i,2*i,2*i)}function DM(s,e){let[t,n,i]=[Cs*e(),Cs*e(),2*Math.PI*e()],r=.5+1.1*e();s.strokeStyle=e()<.7?"#8e1f2a66":"#4a3a6a4d";for(let o=0;o<Dm;o++){let[a,l]=[t,n];if(i+=.7*(e()-.5),t+=Nm*Math.cos(i),n+=Nm*Math.sin(i),s.lineWidth=r*(1-o/Dm)+.3,s.beginPath(),s.moveTo(a,l),s.lineTo(t,n),s.stroke(),o%24!==12)continue;let c=i+(e()<.5?1:-1);s.beginPath(),s.moveTo(t,n),s.lineTo(t+14*Math.cos(c),n+14*Math.sin(c)),s.stroke()}}function NM(s){let e=s;return()=>{e=e+1831565813|0;let t=Math.imul(e^e>>>15,1|e);return t=t+Math.imul(t^t>>>7,61|t)^t,((t^t>>>14)>>>0)/4294967296}}var sc=class{group=new Pe;meshes=[];needed=[];shown=[];meet(e){for(let t of e){let n=new Ye,i=new Uint32Array(Oo(t.triangles).buffer);n.setIndex(new bt(i,1)),this.needed.push(3*(i.reduce((h,u)=>Math.max(h,u),-1)+1));let[r,o,a]=t.color,l=new Mt({color:new ve().setRGB(r??1,o??1,a??1),map:Cr(),roughness:.48,side:It,opacity:t.opacity,transparent:t.opacity<1}),c=new ue(n,l);c.name=t.name,c.castShadow=c.receiveShadow=t.opacity>=1,c.frustumCulled=!1,c.visible=!1,this.meshes.push(c),this.group.add(c)}}update(e){let t=!1;return this.meshes.forEach((n,i)=>{let r=e[i];!r||No(r.body,this.shown[i])||(this.shown[i]=r.body,n.visible=r.levels.length>0&&r.levels.length>=(this.needed[i]??0),n.visible&&OM(n.geometry,r),t=!0)}),t}vertices(e){let t=this.meshes.find(n=>n.name===e&&n.visible);return t?[...t.geometry.getAttribute("position").array]:[]}};function OM(s,{low:e,step:t,levels:n}){let i=s.getAttribute("position");i?.array.length!==n.length&&(i=new bt(new Float32Array(n.length),3),s.dispose(),s.deleteAttribute("normal"),s.setAttribute("position",i),s.deleteAttribute("uv"));for(let r=0;r<n.length;r++)i.array[r]=e[r%3]+t[r%3]*n[r];i.needsUpdate=!0,s.hasAttribute("uv")||Pr(s),s.computeVertexNormals()}function Oo(s){let e=atob(s),t=new Uint8Array(e.length);for(let n=0;n<e.length;n++)t[n]=e.charCodeAt(n);return t}var jt=2255049,UM=6467071,Uo=14711552,Ps=14162730,Om=9060305,Um=[],Ir=jt;function Ci(s){return s.color.setHex(Ir),Um.push(s),s}function Fm(s){Ir=s?UM:jt;for(let e of Um)e.color.setHex(Ir)}function At(s,e=1){return new lt({color:s,opacity:e,transparent:e<1,depthWrite:e>=1,toneMapped:!1})}function Hu(s,e){if(e===fu)return console.warn("THREE.BufferGeometryUtils.toTrianglesDrawMode(): Geometry already defined as triangles."),s;if(e===wr||e===Ro){let t=s.getIndex();if(t===null){let r=[],o=s.getAttribute("position");if(o!==void 0){for(let a=0;a<o.count;a++)r.push(a);s.setIndex(r),t=s.getIndex()}else return console.error("THREE.BufferGeometryUtils.toTrianglesDrawMode(): Undefined position attribute. Processing not possible."),s}let n=t.count-2,i=[];if(e===wr)for(let r=1;r<=n;r++)i.push(t.getX(0)),i.push(t.getX(r)),i.push(t.getX(r+1));else for(let r=0;r<n;r++)r%2===0?(i.push(t.getX(r)),i.push(t.getX(r+1)),i.push(t.getX(r+2))):(i.push(t.getX(r+2)),i.push(t.getX(r+1)),i.push(t.getX(r)));return i.length/3!==n&&console.error("THREE.BufferGeometryUtils.toTrianglesDrawMode(): Unable to generate correct amount of triangles."),s.setIndex(i),s.clearGroups(),s}else return console.error("THREE.BufferGeometryUtils.toTrianglesDrawMode(): Unknown draw mode:",e),s}function km(s){let e=new Map,t=new Map,n=s.clone();return Bm(s,n,function(i,r){e.set(r,i),t.set(i,r)}),n.traverse(function(i){if(!i.isSkinnedMesh)return;let r=i,o=e.get(i),a=o.skeleton.bones;r.skeleton=o.skeleton.clone(),r.bindMatrix.copy(o.bindMatrix),r.skeleton.bones=a.map(function(l){return t.get(l)}),r.bind(r.skeleton,r.bindMatrix)}),n}function Bm(s,e,t){t(s,e);for(let n=0;n<s.children.length;n++)Bm(s.children[n],e.children[n],t)}var Dr=class extends Qn{constructor(e){super(e),this.dracoLoader=null,this.ktx2Loader=null,this.meshoptDecoder=null,this.pluginCallbacks=[],this.register(function(t){return new Yu(t)}),this.register(function(t){return new Ku(t)}),this.register(function(t){return new ju(t)}),this.register(function(t){return new rd(t)}),this.register(function(t){return new od(t)}),this.register(function(t){return new ad(t)}),this.register(function(t){return new Ju(t)}),this.register(function(t){return new Qu(t)}),this.register(function(t){return new ed(t)}),this.register(function(t){return new td(t)}),this.register(function(t){return new $u(t)}),this.register(function(t){return new nd(t)}),this.register(function(t){return new Zu(t)}),this.register(function(t){return new sd(t)}),this.register(function(t){return new id(t)}),this.register(function(t){return new Xu(t)}),this.register(function(t){return new rc(t,$e.EXT_MESHOPT_COMPRESSION)}),this.register(function(t){return new rc(t,$e.KHR_MESHOPT_COMPRESSION)}),this.register(function(t){return new ld(t)})}load(e,t,n,i){let r=this,o;if(this.resourcePath!=="")o=this.resourcePath;else if(this.path!==""){let c=Ai.extractUrlBase(e);o=Ai.resolveURL(c,this.path)}else o=Ai.extractUrlBase(e);this.manager.itemStart(e);let a=function(c){i?i(c):console.error(c),r.manager.itemError(e),r.manager.itemEnd(e)},l=new pr(this.manager);l.setPriority(this.priority),l.setCache(this.cache),l.setPath(this.path),l.setResponseType("arraybuffer"),l.setRequestHeader(this.requestHeader),l.setWithCredentials(this.withCredentials),l.load(e,function(c){try{r.parse(c,o,function(h){t(h),r.manager.itemEnd(e)},a)}catch(h){a(h)}},n,a)}setDRACOLoader(e){return this.dracoLoader=e,this}setKTX2Loader(e){return this.ktx2Loader=e,this}setMeshoptDecoder(e){return this.meshoptDecoder=e,this}register(e){return this.pluginCallbacks.indexOf(e)===-1&&this.pluginCallbacks.push(e),this}unregister(e){return this.pluginCallbacks.indexOf(e)!==-1&&this.pluginCallbacks.splice(this.pluginCallbacks.indexOf(e),1),this}parse(e,t,n,i){let r,o={},a={},l=new TextDecoder;if(typeof e=="string")r=JSON.parse(e);else if(e instanceof ArrayBuffer)if(l.decode(new Uint8Array(e,0,4))===Wm){try{o[$e.KHR_BINARY_GLTF]=new cd(e)}catch(u){i&&i(u);return}r=JSON.parse(o[$e.KHR_BINARY_GLTF].content)}else r=JSON.parse(l.decode(e));else r=e;if(r.asset===void 0||r.asset.version[0]<2){i&&i(new Error("THREE.GLTFLoader: Unsupported asset. glTF versions >=2.0 are supported."));return}let c=new gd(r,{path:t||this.resourcePath||"",crossOrigin:this.crossOrigin,priority:this.priority,cache:this.cache,withCredentials:this.withCredentials,requestHeader:this.requestHeader,manager:this.manager,ktx2Loader:this.ktx2Loader,meshoptDecoder:this.meshoptDecoder});c.fileLoader.setRequestHeader(this.requestHeader);for(let h=0;h<this.pluginCallbacks.length;h++){let u=this.pluginCallbacks[h](c);u.name||console.error("THREE.GLTFLoader: Invalid plugin found: missing name"),a[u.name]=u,o[u.name]=!0}if(r.extensionsUsed)for(let h=0;h<r.extensionsUsed.length;++h){let u=r.extensionsUsed[h],d=r.extensionsRequired||[];switch(u){case $e.KHR_MATERIALS_UNLIT:o[u]=new qu;break;case $e.KHR_DRACO_MESH_COMPRESSION:o[u]=new hd(r,this.dracoLoader);break;case $e.KHR_TEXTURE_TRANSFORM:o[u]=new ud;break;case $e.KHR_MESH_QUANTIZATION:o[u]=new dd;break;default:d.indexOf(u)>=0&&a[u]===void 0&&console.warn('THREE.GLTFLoader: Unknown extension "'+u+'".')}}c.setExtensions(o),c.setPlugins(a),c.parse(n,i)}parseAsync(e,t){let n=this;return new Promise(function(i,r){n.parse(e,t,i,r)})}};function FM(){let s={};return{get:function(e){return s[e]},add:function(e,t){s[e]=t},remove:function(e){delete s[e]},removeAll:function(){s={}}}}function _t(s,e,t){let n=s.json.materials[e];return n.extensions&&n.extensions[t]?n.extensions[t]:null}var $e={KHR_BINARY_GLTF:"KHR_binary_glTF",KHR_DRACO_MESH_COMPRESSION:"KHR_draco_mesh_compression",KHR_LIGHTS_PUNCTUAL:"KHR_lights_punctual",KHR_MATERIALS_CLEARCOAT:"KHR_materials_clearcoat",KHR_MATERIALS_DIFFUSE_ROUGHNESS:"KHR_materials_diffuse_roughness",KHR_MATERIALS_DISPERSION:"KHR_materials_dispersion",KHR_MATERIALS_IOR:"KHR_materials_ior",KHR_MATERIALS_SHEEN:"KHR_materials_sheen",KHR_MATERIALS_SPECULAR:"KHR_materials_specular",KHR_MATERIALS_TRANSMISSION:"KHR_materials_transmission",KHR_MATERIALS_IRIDESCENCE:"KHR_materials_iridescence",KHR_MATERIALS_ANISOTROPY:"KHR_materials_anisotropy",KHR_MATERIALS_UNLIT:"KHR_materials_unlit",KHR_MATERIALS_VOLUME:"KHR_materials_volume",KHR_TEXTURE_BASISU:"KHR_texture_basisu",KHR_TEXTURE_TRANSFORM:"KHR_texture_transform",KHR_MESH_QUANTIZATION:"KHR_mesh_quantization",KHR_MATERIALS_EMISSIVE_STRENGTH:"KHR_materials_emissive_strength",EXT_MATERIALS_BUMP:"EXT_materials_bump",EXT_TEXTURE_WEBP:"EXT_texture_webp",EXT_TEXTURE_AVIF:"EXT_texture_avif",EXT_MESHOPT_COMPRESSION:"EXT_meshopt_compression",KHR_MESHOPT_COMPRESSION:"KHR_meshopt_compression",EXT_MESH_GPU_INSTANCING:"EXT_mesh_gpu_instancing"},Xu=class{constructor(e){this.parser=e,this.name=$e.KHR_LIGHTS_PUNCTUAL,this.cache={refs:{},uses:{}}}_markDefs(){let e=this.parser,t=this.parser.json.nodes||[];for(let n=0,i=t.length;n<i;n++){let r=t[n];r.extensions&&r.extensions[this.name]&&r.extensions[this.name].light!==void 0&&e._addNodeRef(this.cache,r.extensions[this.name].light)}}_loadLight(e){let t=this.parser,n="light:"+e,i=t.cache.get(n);if(i)return i;let r=t.json,l=((r.extensions&&r.extensions[this.name]||{}).lights||[])[e],c,h=new ve(16777215);l.color!==void 0&&h.setRGB(l.color[0],l.color[1],l.color[2],an);let u=l.range!==void 0?l.range:0;switch(l.type){case"directional":c=new Ki(h),c.target.position.set(0,0,-1),c.add(c.target);break;case"point":c=new ys(h),c.distance=u;break;case"spot":c=new xs(h),c.distance=u,l.spot=l.spot||{},l.spot.innerConeAngle=l.spot.innerConeAngle!==void 0?l.spot.innerConeAngle:0,l.spot.outerConeAngle=l.spot.outerConeAngle!==void 0?l.spot.outerConeAngle:Math.PI/4,c.angle=l.spot.outerConeAngle,c.penumbra=1-l.spot.innerConeAngle/l.spot.outerConeAngle,c.target.position.set(0,0,-1),c.add(c.target);break;default:throw new Error("THREE.GLTFLoader: Unexpected light type: "+l.type)}return c.position.set(0,0,0),ri(c,l),l.intensity!==void 0&&(c.intensity=l.intensity),c.name=t.createUniqueName(l.name||"light_"+e),i=Promise.resolve(c),t.cache.add(n,i),i}getDependency(e,t){if(e==="light")return this._loadLight(t)}createNodeAttachment(e){let t=this,n=this.parser,r=n.json.nodes[e],a=(r.extensions&&r.extensions[this.name]||{}).light;return a===void 0?null:this._loadLight(a).then(function(l){return n._getNodeRef(t.cache,a,l)})}},qu=class{constructor(){this.name=$e.KHR_MATERIALS_UNLIT}getMaterialType(){return lt}extendParams(e,t,n){let i=[];e.color=new ve(1,1,1),e.opacity=1;let r=t.pbrMetallicRoughness;if(r){if(Array.isArray(r.baseColorFactor)){let o=r.baseColorFactor;e.color.setRGB(o[0],o[1],o[2],an),e.opacity=o[3]}r.baseColorTexture!==void 0&&i.push(n.assignTexture(e,"map",r.baseColorTexture,ot))}return Promise.all(i)}},$u=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_EMISSIVE_STRENGTH}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);return n===null||n.emissiveStrength!==void 0&&(t.emissiveIntensity=n.emissiveStrength),Promise.resolve()}},Yu=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_CLEARCOAT}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];if(n.clearcoatFactor!==void 0&&(t.clearcoat=n.clearcoatFactor),n.clearcoatTexture!==void 0&&i.push(this.parser.assignTexture(t,"clearcoatMap",n.clearcoatTexture)),n.clearcoatRoughnessFactor!==void 0&&(t.clearcoatRoughness=n.clearcoatRoughnessFactor),n.clearcoatRoughnessTexture!==void 0&&i.push(this.parser.assignTexture(t,"clearcoatRoughnessMap",n.clearcoatRoughnessTexture)),n.clearcoatNormalTexture!==void 0&&(i.push(this.parser.assignTexture(t,"clearcoatNormalMap",n.clearcoatNormalTexture)),n.clearcoatNormalTexture.scale!==void 0)){let r=n.clearcoatNormalTexture.scale;t.clearcoatNormalScale=new ye(r,r)}return Promise.all(i)}},Ku=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_DIFFUSE_ROUGHNESS}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];return t.diffuseRoughness=n.diffuseRoughnessFactor!==void 0?n.diffuseRoughnessFactor:0,n.diffuseRoughnessTexture!==void 0&&i.push(this.parser.assignTexture(t,"diffuseRoughnessMap",n.diffuseRoughnessTexture)),Promise.all(i)}},ju=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_DISPERSION}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);return n===null||(t.dispersion=n.dispersion!==void 0?n.dispersion:0),Promise.resolve()}},Zu=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_IRIDESCENCE}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];return n.iridescenceFactor!==void 0&&(t.iridescence=n.iridescenceFactor),n.iridescenceTexture!==void 0&&i.push(this.parser.assignTexture(t,"iridescenceMap",n.iridescenceTexture)),n.iridescenceIor!==void 0&&(t.iridescenceIOR=n.iridescenceIor),n.iridescenceThicknessMinimum!==void 0&&(t.iridescenceThicknessMinimum=n.iridescenceThicknessMinimum),n.iridescenceThicknessMaximum!==void 0&&(t.iridescenceThicknessMaximum=n.iridescenceThicknessMaximum),n.iridescenceThicknessTexture!==void 0&&i.push(this.parser.assignTexture(t,"iridescenceThicknessMap",n.iridescenceThicknessTexture)),Promise.all(i)}},Ju=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_SHEEN}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];if(t.sheenColor=new ve(0,0,0),t.sheenRoughness=0,t.sheen=1,n.sheenColorFactor!==void 0){let r=n.sheenColorFactor;t.sheenColor.setRGB(r[0],r[1],r[2],an)}return n.sheenRoughnessFactor!==void 0&&(t.sheenRoughness=n.sheenRoughnessFactor),n.sheenColorTexture!==void 0&&i.push(this.parser.assignTexture(t,"sheenColorMap",n.sheenColorTexture,ot)),n.sheenRoughnessTexture!==void 0&&i.push(this.parser.assignTexture(t,"sheenRoughnessMap",n.sheenRoughnessTexture)),Promise.all(i)}},Qu=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_TRANSMISSION}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];return n.transmissionFactor!==void 0&&(t.transmission=n.transmissionFactor),n.transmissionTexture!==void 0&&i.push(this.parser.assignTexture(t,"transmissionMap",n.transmissionTexture)),Promise.all(i)}},ed=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_VOLUME}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];t.thickness=n.thicknessFactor!==void 0?n.thicknessFactor:0,n.thicknessTexture!==void 0&&i.push(this.parser.assignTexture(t,"thicknessMap",n.thicknessTexture)),t.attenuationDistance=n.attenuationDistance||1/0;let r=n.attenuationColor||[1,1,1];return t.attenuationColor=new ve().setRGB(r[0],r[1],r[2],an),Promise.all(i)}},td=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_IOR}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);return n===null||(t.ior=n.ior!==void 0?n.ior:1.5,t.ior===0&&(t.ior=1e3)),Promise.resolve()}},nd=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_SPECULAR}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];t.specularIntensity=n.specularFactor!==void 0?n.specularFactor:1,n.specularTexture!==void 0&&i.push(this.parser.assignTexture(t,"specularIntensityMap",n.specularTexture));let r=n.specularColorFactor||[1,1,1];return t.specularColor=new ve().setRGB(r[0],r[1],r[2],an),n.specularColorTexture!==void 0&&i.push(this.parser.assignTexture(t,"specularColorMap",n.specularColorTexture,ot)),Promise.all(i)}},id=class{constructor(e){this.parser=e,this.name=$e.EXT_MATERIALS_BUMP}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];return t.bumpScale=n.bumpFactor!==void 0?n.bumpFactor:1,n.bumpTexture!==void 0&&i.push(this.parser.assignTexture(t,"bumpMap",n.bumpTexture)),Promise.all(i)}},sd=class{constructor(e){this.parser=e,this.name=$e.KHR_MATERIALS_ANISOTROPY}getMaterialType(e){return _t(this.parser,e,this.name)!==null?cn:null}extendMaterialParams(e,t){let n=_t(this.parser,e,this.name);if(n===null)return Promise.resolve();let i=[];return n.anisotropyStrength!==void 0&&(t.anisotropy=n.anisotropyStrength),n.anisotropyRotation!==void 0&&(t.anisotropyRotation=n.anisotropyRotation),n.anisotropyTexture!==void 0&&i.push(this.parser.assignTexture(t,"anisotropyMap",n.anisotropyTexture)),Promise.all(i)}},rd=class{constructor(e){this.parser=e,this.name=$e.KHR_TEXTURE_BASISU}loadTexture(e){let t=this.parser,n=t.json,i=n.textures[e];if(!i.extensions||!i.extensions[this.name])return null;let r=i.extensions[this.name],o=t.options.ktx2Loader;if(!o){if(n.extensionsRequired&&n.extensionsRequired.indexOf(this.name)>=0)throw new Error("THREE.GLTFLoader: setKTX2Loader must be called before loading KTX2 textures");return null}return t.loadTextureImage(e,r.source,o)}},od=class{constructor(e){this.parser=e,this.name=$e.EXT_TEXTURE_WEBP}loadTexture(e){let t=this.name,n=this.parser,i=n.json,r=i.textures[e];if(!r.extensions||!r.extensions[t])return null;let o=r.extensions[t],a=i.images[o.source],l=n.textureLoader;if(a.uri){let c=n.options.manager.getHandler(a.uri);c!==null&&(l=c)}return n.loadTextureImage(e,o.source,l)}},ad=class{constructor(e){this.parser=e,this.name=$e.EXT_TEXTURE_AVIF}loadTexture(e){let t=this.name,n=this.parser,i=n.json,r=i.textures[e];if(!r.extensions||!r.extensions[t])return null;let o=r.extensions[t],a=i.images[o.source],l=n.textureLoader;if(a.uri){let c=n.options.manager.getHandler(a.uri);c!==null&&(l=c)}return n.loadTextureImage(e,o.source,l)}},rc=class{constructor(e,t){this.name=t,this.parser=e}loadBufferView(e){let t=this.parser.json,n=t.bufferViews[e];if(n.extensions&&n.extensions[this.name]){let i=n.extensions[this.name],r=this.parser.getDependency("buffer",i.buffer),o=this.parser.options.meshoptDecoder;if(!o||!o.supported){if(t.extensionsRequired&&t.extensionsRequired.indexOf(this.name)>=0)throw new Error("THREE.GLTFLoader: setMeshoptDecoder must be called before loading compressed files");return null}return r.then(function(a){let l=i.byteOffset||0,c=i.byteLength||0,h=i.count,u=i.byteStride,d=new Uint8Array(a,l,c);return o.decodeGltfBufferAsync?o.decodeGltfBufferAsync(h,u,d,i.mode,i.filter).then(function(f){return f.buffer}):o.ready.then(function(){let f=new ArrayBuffer(h*u);return o.decodeGltfBuffer(new Uint8Array(f),h,u,d,i.mode,i.filter),f})})}else return null}},ld=class{constructor(e){this.name=$e.EXT_MESH_GPU_INSTANCING,this.parser=e}createNodeMesh(e){let t=this.parser.json,n=t.nodes[e];if(!n.extensions||!n.extensions[this.name]||n.mesh===void 0)return null;let i=t.meshes[n.mesh];for(let c of i.primitives)if(c.mode!==Nn.TRIANGLES&&c.mode!==Nn.TRIANGLE_STRIP&&c.mode!==Nn.TRIANGLE_FAN&&c.mode!==void 0)return null;let o=n.extensions[this.name].attributes,a=[],l={};for(let c in o)a.push(this.parser.getDependency("accessor",o[c]).then(h=>(l[c]=h,l[c])));return a.length<1?null:(a.push(this.parser.createNodeMesh(e)),Promise.all(a).then(c=>{let h=c.pop(),u=h.isGroup?h.children:[h],d=c[0].count,f=[];for(let g of u){let y=new _e,p=new S,m=new De,b=new S(1,1,1),E=new _i(g.geometry,g.material,d);for(let R=0;R<d;R++)l.TRANSLATION&&p.fromBufferAttribute(l.TRANSLATION,R),l.ROTATION&&m.fromBufferAttribute(l.ROTATION,R),l.SCALE&&b.fromBufferAttribute(l.SCALE,R),E.setMatrixAt(R,y.compose(p,m,b));let M=null;for(let R in l)if(R==="_COLOR_0"){let T=l[R];E.instanceColor=new vi(T.array,T.itemSize,T.normalized)}else if(R!=="TRANSLATION"&&R!=="ROTATION"&&R!=="SCALE"){if(M===null){let x=E.geometry;M=new Ye,M.name=x.name;for(let w in x.attributes)M.setAttribute(w,x.attributes[w]);for(let w in x.morphAttributes)M.morphAttributes[w]=x.morphAttributes[w];x.index!==null&&M.setIndex(x.index),M.morphTargetsRelative=x.morphTargetsRelative;for(let w of x.groups)M.addGroup(w.start,w.count,w.materialIndex);x.boundingBox!==null&&(M.boundingBox=x.boundingBox.clone()),x.boundingSphere!==null&&(M.boundingSphere=x.boundingSphere.clone()),M.drawRange.start=x.drawRange.start,M.drawRange.count=x.drawRange.count,M.userData=Object.assign({},x.userData),E.geometry=M}let T=l[R];M.setAttribute(R,new vi(T.array,T.itemSize,T.normalized))}it.prototype.copy.call(E,g),this.parser.assignFinalMaterial(E),f.push(E)}return h.isGroup?(h.clear(),h.add(...f),h):f[0]}))}},Wm="glTF",Fo=12,zm={JSON:1313821514,BIN:5130562},cd=class{constructor(e){this.name=$e.KHR_BINARY_GLTF,this.content=null,this.body=null;let t=new DataView(e,0,Fo),n=new TextDecoder;if(this.header={magic:n.decode(new Uint8Array(e.slice(0,4))),version:t.getUint32(4,!0),length:t.getUint32(8,!0)},this.header.magic!==Wm)throw new Error("THREE.GLTFLoader: Unsupported glTF-Binary header.");if(this.header.version<2)throw new Error("THREE.GLTFLoader: Legacy binary file detected.");let i=this.header.length-Fo,r=new DataView(e,Fo),o=0;for(;o<i;){let a=r.getUint32(o,!0);o+=4;let l=r.getUint32(o,!0);if(o+=4,l===zm.JSON){let c=new Uint8Array(e,Fo+o,a);this.content=n.decode(c)}else if(l===zm.BIN){let c=Fo+o;this.body=e.slice(c,c+a)}o+=a}if(this.content===null)throw new Error("THREE.GLTFLoader: JSON content not found.")}},hd=class{constructor(e,t){if(!t)throw new Error("THREE.GLTFLoader: No DRACOLoader instance provided.");this.name=$e.KHR_DRACO_MESH_COMPRESSION,this.json=e,this.dracoLoader=t,this.dracoLoader.preload()}decodePrimitive(e,t){let n=this.json,i=this.dracoLoader,r=e.extensions[this.name].bufferView,o=e.extensions[this.name].attributes,a={},l={},c={};for(let h in o){let u=pd[h]||h.toLowerCase();a[u]=o[h]}for(let h in e.attributes){let u=pd[h]||h.toLowerCase();if(o[h]!==void 0){let d=n.accessors[e.attributes[h]],f=Lr[d.componentType];c[u]=f.name,l[u]=d.normalized===!0}}return t.getDependency("bufferView",r).then(function(h){return new Promise(function(u,d){i.decodeDracoFile(h,function(f){for(let g in f.attributes){let y=f.attributes[g],p=l[g];p!==void 0&&(y.normalized=p)}u(f)},a,c,an,d)})})}},ud=class{constructor(){this.name=$e.KHR_TEXTURE_TRANSFORM}extendTexture(e,t){if((t.texCoord===void 0||t.texCoord===e.channel)&&t.offset===void 0&&t.rotation===void 0&&t.scale===void 0)return e;if(e=e.clone(),t.texCoord!==void 0&&(e.channel=t.texCoord),t.offset!==void 0&&e.offset.fromArray(t.offset),t.rotation!==void 0&&(e.rotation=t.rotation),t.scale!==void 0&&e.repeat.fromArray(t.scale),t.rotation!==void 0){let n=Math.cos(e.rotation),i=Math.sin(e.rotation);e.matrix.set(e.repeat.x*n,e.repeat.y*i,e.offset.x,-e.repeat.x*i,e.repeat.y*n,e.offset.y,0,0,1),e.matrixAutoUpdate=!1}return e.needsUpdate=!0,e}},dd=class{constructor(){this.name=$e.KHR_MESH_QUANTIZATION}},oc=class extends Jn{constructor(e,t,n,i){super(e,t,n,i)}copySampleValue_(e){let t=this.resultBuffer,n=this.sampleValues,i=this.valueSize,r=e*i*3+i;for(let o=0;o!==i;o++)t[o]=n[r+o];return t}interpolate_(e,t,n,i){let r=this.resultBuffer,o=this.sampleValues,a=this.valueSize,l=a*2,c=a*3,h=i-t,u=(n-t)/h,d=u*u,f=d*u,g=e*c,y=g-c,p=-2*f+3*d,m=f-d,b=1-p,E=m-d+u;for(let M=0;M!==a;M++){let R=o[y+M+a],T=o[y+M+l]*h,x=o[g+M+a],w=o[g+M]*h;r[M]=b*R+E*T+p*x+m*w}return r}},kM=new De,fd=class extends oc{interpolate_(e,t,n,i){let r=super.interpolate_(e,t,n,i);return kM.fromArray(r).normalize().toArray(r),r}},Nn={FLOAT:5126,FLOAT_MAT3:35675,FLOAT_MAT4:35676,FLOAT_VEC2:35664,FLOAT_VEC3:35665,FLOAT_VEC4:35666,LINEAR:9729,REPEAT:10497,SAMPLER_2D:35678,POINTS:0,LINES:1,LINE_LOOP:2,LINE_STRIP:3,TRIANGLES:4,TRIANGLE_STRIP:5,TRIANGLE_FAN:6,UNSIGNED_BYTE:5121,UNSIGNED_SHORT:5123},Lr={5120:Int8Array,5121:Uint8Array,5122:Int16Array,5123:Uint16Array,5125:Uint32Array,5126:Float32Array},Hm={9728:gt,9729:St,9984:tl,9985:br,9986:Ts,9987:Ln},Gm={33071:Cn,33648:Hi,10497:zi},Gu={SCALAR:1,VEC2:2,VEC3:3,VEC4:4,MAT2:4,MAT3:9,MAT4:16},pd={POSITION:"position",NORMAL:"normal",TANGENT:"tangent",TEXCOORD_0:"uv",TEXCOORD_1:"uv1",TEXCOORD_2:"uv2",TEXCOORD_3:"uv3",COLOR_0:"color",WEIGHTS_0:"skinWeight",JOINTS_0:"skinIndex"},es={scale:"scale",translation:"position",rotation:"quaternion",weights:"morphTargetInfluences"},BM={CUBICSPLINE:void 0,LINEAR:ds,STEP:us},Vu={OPAQUE:"OPAQUE",MASK:"MASK",BLEND:"BLEND"};function zM(s){return s.DefaultMaterial===void 0&&(s.DefaultMaterial=new Mt({color:16777215,emissive:0,metalness:1,roughness:1,transparent:!1,depthTest:!0,side:ei})),s.DefaultMaterial}function Is(s,e,t){for(let n in t.extensions)s[n]===void 0&&(e.userData.gltfExtensions=e.userData.gltfExtensions||{},e.userData.gltfExtensions[n]=t.extensions[n])}function ri(s,e){e.extras!==void 0&&(typeof e.extras=="object"?Object.assign(s.userData,e.extras):console.warn("THREE.GLTFLoader: Ignoring primitive type .extras, "+e.extras))}function HM(s,e,t){let n=!1,i=!1,r=!1;for(let c=0,h=e.length;c<h;c++){let u=e[c];if(u.POSITION!==void 0&&(n=!0),u.NORMAL!==void 0&&(i=!0),u.COLOR_0!==void 0&&(r=!0),n&&i&&r)break}if(!n&&!i&&!r)return Promise.resolve(s);let o=[],a=[],l=[];for(let c=0,h=e.length;c<h;c++){let u=e[c];if(n){let d=u.POSITION!==void 0?t.getDependency("accessor",u.POSITION):s.attributes.position;o.push(d)}if(i){let d=u.NORMAL!==void 0?t.getDependency("accessor",u.NORMAL):s.attributes.normal;a.push(d)}if(r){let d=u.COLOR_0!==void 0?t.getDependency("accessor",u.COLOR_0):s.attributes.color;l.push(d)}}return Promise.all([Promise.all(o),Promise.all(a),Promise.all(l)]).then(function(c){let h=c[0],u=c[1],d=c[2];return n&&(s.morphAttributes.position=h),i&&(s.morphAttributes.normal=u),r&&(s.morphAttributes.color=d),s.morphTargetsRelative=!0,s})}function GM(s,e){if(s.updateMorphTargets(),e.weights!==void 0)for(let t=0,n=e.weights.length;t<n;t++)s.morphTargetInfluences[t]=e.weights[t];if(e.extras&&Array.isArray(e.extras.targetNames)){let t=e.extras.targetNames;if(s.morphTargetInfluences.length===t.length){s.morphTargetDictionary={};for(let n=0,i=t.length;n<i;n++)s.morphTargetDictionary[t[n]]=n}else console.warn("THREE.GLTFLoader: Invalid extras.targetNames length. Ignoring names.")}}function VM(s){let e,t=s.extensions&&s.extensions[$e.KHR_DRACO_MESH_COMPRESSION];if(t?e="draco:"+t.bufferView+":"+t.indices+":"+Wu(t.attributes):e=s.indices+":"+Wu(s.attributes)+":"+s.mode,s.targets!==void 0)for(let n=0,i=s.targets.length;n<i;n++)e+=":"+Wu(s.targets[n]);return e}function Wu(s){let e="",t=Object.keys(s).sort();for(let n=0,i=t.length;n<i;n++)e+=t[n]+":"+s[t[n]]+";";return e}function md(s){switch(s){case Int8Array:return 1/127;case Uint8Array:return 1/255;case Int16Array:return 1/32767;case Uint16Array:return 1/65535;default:throw new Error("THREE.GLTFLoader: Unsupported normalized accessor component type.")}}function WM(s){return s.search(/\.jpe?g($|\?)/i)>0||s.search(/^data\:image\/jpeg/)===0?"image/jpeg":s.search(/\.webp($|\?)/i)>0||s.search(/^data\:image\/webp/)===0?"image/webp":s.search(/\.ktx2($|\?)/i)>0||s.search(/^data\:image\/ktx2/)===0?"image/ktx2":"image/png"}var XM=new _e,gd=class{constructor(e={},t={}){this.json=e,this.extensions={},this.plugins={},this.options=t,this.cache=new FM,this.associations=new Map,this.primitiveCache={},this.nodeCache={},this.meshCache={refs:{},uses:{}},this.cameraCache={refs:{},uses:{}},this.lightCache={refs:{},uses:{}},this.sourceCache={},this.textureCache={},this.nodeNamesUsed={};let n=!1,i=-1,r=!1,o=-1;if(typeof navigator<"u"&&typeof navigator.userAgent<"u"){let a=navigator.userAgent;n=/^((?!chrome|android).)*safari/i.test(a)===!0;let l=a.match(/Version\/(\d+)/);i=n&&l?parseInt(l[1],10):-1,r=a.indexOf("Firefox")>-1,o=r?a.match(/Firefox\/([0-9]+)\./)[1]:-1}typeof createImageBitmap>"u"||n&&i<17||r&&o<98?(this.textureLoader=new mo(this.options.manager),this.textureLoader.setPriority(this.options.priority),this.textureLoader.setCache(this.options.cache)):(this.textureLoader=new yo(this.options.manager),this.textureLoader.setPriority(this.options.priority),this.textureLoader.setCache(this.options.cache)),this.textureLoader.setCrossOrigin(this.options.crossOrigin),this.textureLoader.setWithCredentials(this.options.withCredentials),this.textureLoader.setRequestHeader(this.options.requestHeader),this.fileLoader=new pr(this.options.manager),this.fileLoader.setPriority(this.options.priority),this.fileLoader.setCache(this.options.cache),this.fileLoader.setResponseType("arraybuffer"),(this.options.withCredentials||this.options.crossOrigin==="use-credentials")&&this.fileLoader.setWithCredentials(!0)}setExtensions(e){this.extensions=e}setPlugins(e){this.plugins=e}parse(e,t){let n=this,i=this.json,r=this.extensions;this.cache.removeAll(),this.nodeCache={},this._invokeAll(function(o){return o._markDefs&&o._markDefs()}),Promise.all(this._invokeAll(function(o){return o.beforeRoot&&o.beforeRoot()})).then(function(){return Promise.all([n.getDependencies("scene"),n.getDependencies("animation"),n.getDependencies("camera")])}).then(function(o){let a={scene:o[0][i.scene||0],scenes:o[0],animations:o[1],cameras:o[2],asset:i.asset,parser:n,userData:{}};return Is(r,a,i),ri(a,i),Promise.all(n._invokeAll(function(l){return l.afterRoot&&l.afterRoot(a)})).then(function(){for(let l of a.scenes)l.updateMatrixWorld();e(a)})}).catch(t)}_markDefs(){let e=this.json.nodes||[],t=this.json.skins||[],n=this.json.meshes||[];for(let i=0,r=t.length;i<r;i++){let o=t[i].joints;for(let a=0,l=o.length;a<l;a++)e[o[a]].isBone=!0}for(let i=0,r=e.length;i<r;i++){let o=e[i];o.mesh!==void 0&&(this._addNodeRef(this.meshCache,o.mesh),o.skin!==void 0&&(n[o.mesh].isSkinnedMesh=!0)),o.camera!==void 0&&this._addNodeRef(this.cameraCache,o.camera)}}_addNodeRef(e,t){t!==void 0&&(e.refs[t]===void 0&&(e.refs[t]=e.uses[t]=0),e.refs[t]++)}_getNodeRef(e,t,n){if(e.refs[t]<=1)return n;let i=n.clone(),r=(o,a)=>{let l=this.associations.get(o);l!=null&&this.associations.set(a,l);for(let[c,h]of o.children.entries())r(h,a.children[c])};return r(n,i),i.name+="_instance_"+e.uses[t]++,i}_invokeOne(e){let t=Object.values(this.plugins);t.push(this);for(let n=0;n<t.length;n++){let i=e(t[n]);if(i)return i}return null}_invokeAll(e){let t=Object.values(this.plugins);t.unshift(this);let n=[];for(let i=0;i<t.length;i++){let r=e(t[i]);r&&n.push(r)}return n}getDependency(e,t){let n=e+":"+t,i=this.cache.get(n);if(!i){switch(e){case"scene":i=this.loadScene(t);break;case"node":i=this._invokeOne(function(r){return r.loadNode&&r.loadNode(t)});break;case"mesh":i=this._invokeOne(function(r){return r.loadMesh&&r.loadMesh(t)});break;case"accessor":i=this.loadAccessor(t);break;case"bufferView":i=this._invokeOne(function(r){return r.loadBufferView&&r.loadBufferView(t)});break;case"buffer":i=this.loadBuffer(t);break;case"material":i=this._invokeOne(function(r){return r.loadMaterial&&r.loadMaterial(t)});break;case"texture":i=this._invokeOne(function(r){return r.loadTexture&&r.loadTexture(t)});break;case"skin":i=this.loadSkin(t);break;case"animation":i=this._invokeOne(function(r){return r.loadAnimation&&r.loadAnimation(t)});break;case"camera":i=this.loadCamera(t);break;default:if(i=this._invokeOne(function(r){return r!=this&&r.getDependency&&r.getDependency(e,t)}),!i)throw new Error("Unknown type: "+e);break}this.cache.add(n,i)}return i}getDependencies(e){let t=this.cache.get(e);if(!t){let n=this,i=this.json[e+(e==="mesh"?"es":"s")]||[];t=Promise.all(i.map(function(r,o){return n.getDependency(e,o)})),this.cache.add(e,t)}return t}loadBuffer(e){let t=this.json.buffers[e],n=this.fileLoader;if(t.type&&t.type!=="arraybuffer")throw new Error("THREE.GLTFLoader: "+t.type+" buffer type is not supported.");if(t.uri===void 0&&e===0)return Promise.resolve(this.extensions[$e.KHR_BINARY_GLTF].body);let i=this.options;return new Promise(function(r,o){n.load(Ai.resolveURL(t.uri,i.path),r,void 0,function(){o(new Error('THREE.GLTFLoader: Failed to load buffer "'+t.uri+'".'))})})}loadBufferView(e){let t=this.json.bufferViews[e];return this.getDependency("buffer",t.buffer).then(function(n){let i=t.byteLength||0,r=t.byteOffset||0;return n.slice(r,r+i)})}loadAccessor(e){let t=this,n=this.json,i=this.json.accessors[e];if(i.bufferView===void 0&&i.sparse===void 0){let o=Gu[i.type],a=Lr[i.componentType],l=i.normalized===!0,c=new a(i.count*o);return Promise.resolve(new bt(c,o,l))}let r=[];return i.bufferView!==void 0?r.push(this.getDependency("bufferView",i.bufferView)):r.push(null),i.sparse!==void 0&&(r.push(this.getDependency("bufferView",i.sparse.indices.bufferView)),r.push(this.getDependency("bufferView",i.sparse.values.bufferView))),Promise.all(r).then(function(o){let a=o[0],l=Gu[i.type],c=Lr[i.componentType],h=c.BYTES_PER_ELEMENT,u=h*l,d=i.byteOffset||0,f=i.bufferView!==void 0?n.bufferViews[i.bufferView].byteStride:void 0,g=i.normalized===!0,y,p;if(f&&f!==u){let m=Math.floor(d/f),b="InterleavedBuffer:"+i.bufferView+":"+i.componentType+":"+m+":"+i.count,E=t.cache.get(b);E||(y=new c(a,m*f,i.count*f/h),E=new ps(y,f/h),t.cache.add(b,E)),p=new Gi(E,l,d%f/h,g)}else a===null?y=new c(i.count*l):y=new c(a,d,i.count*l),p=new bt(y,l,g);if(i.sparse!==void 0){let m=Gu.SCALAR,b=Lr[i.sparse.indices.componentType],E=i.sparse.indices.byteOffset||0,M=i.sparse.values.byteOffset||0,R=new b(o[1],E,i.sparse.count*m),T=new c(o[2],M,i.sparse.count*l);a!==null&&(p=new bt(p.array.slice(),p.itemSize,p.normalized)),p.normalized=!1;for(let x=0,w=R.length;x<w;x++){let O=R[x];if(p.setX(O,T[x*l]),l>=2&&p.setY(O,T[x*l+1]),l>=3&&p.setZ(O,T[x*l+2]),l>=4&&p.setW(O,T[x*l+3]),l>=5)throw new Error("THREE.GLTFLoader: Unsupported itemSize in sparse BufferAttribute.")}p.normalized=g}return p})}loadTexture(e){let t=this.json,n=this.options,r=t.textures[e].source,o=t.images[r],a=this.textureLoader;if(o.uri){let l=n.manager.getHandler(o.uri);l!==null&&(a=l)}return this.loadTextureImage(e,r,a)}loadTextureImage(e,t,n){let i=this,r=this.json,o=r.textures[e],a=r.images[t],l=(a.uri||a.bufferView)+":"+o.sampler;if(this.textureCache[l])return this.textureCache[l];let c=this.loadImageSource(t,n).then(function(h){h.flipY=!1,h.name=o.name||a.name||"",h.name===""&&typeof a.uri=="string"&&a.uri.startsWith("data:image/")===!1&&(h.name=a.uri);let d=(r.samplers||{})[o.sampler]||{};return h.magFilter=Hm[d.magFilter]||St,h.minFilter=Hm[d.minFilter]||Ln,h.wrapS=Gm[d.wrapS]||zi,h.wrapT=Gm[d.wrapT]||zi,h.generateMipmaps=!h.isCompressedTexture&&h.minFilter!==gt&&h.minFilter!==St,i.associations.set(h,{textures:e}),h}).catch(function(){return null});return this.textureCache[l]=c,c}loadImageSource(e,t){let n=this,i=this.json,r=this.options;if(this.sourceCache[e]!==void 0)return this.sourceCache[e].then(d=>d.clone());let o=i.images[e],a=self.URL||self.webkitURL,l=o.uri||"",c=!1,h;if(t.isKTX2Loader===!0&&o.bufferView!==void 0)h=n.getDependency("bufferView",o.bufferView).then(function(d){return new Promise(function(f,g){t.parse(d,f,g)})});else{if(o.bufferView!==void 0)l=n.getDependency("bufferView",o.bufferView).then(function(d){c=!0;let f=new Blob([d],{type:o.mimeType});return l=a.createObjectURL(f),l});else if(o.uri===void 0)throw new Error("THREE.GLTFLoader: Image "+e+" is missing URI and bufferView");h=Promise.resolve(l).then(function(d){return new Promise(function(f,g){let y=f;t.isImageBitmapLoader===!0&&(y=function(p){let m=new Nt(p);m.needsUpdate=!0,f(m)}),t.load(Ai.resolveURL(d,r.path),y,void 0,g)})})}let u=h.then(function(d){return c===!0&&a.revokeObjectURL(l),ri(d,o),d.userData.mimeType=o.mimeType||WM(o.uri),d}).catch(function(d){throw console.error("THREE.GLTFLoader: Couldn't load texture",l),d});return this.sourceCache[e]=u,u}assignTexture(e,t,n,i){let r=this;return this.getDependency("texture",n.index).then(function(o){if(!o)return null;if(n.texCoord!==void 0&&n.texCoord>0&&(o=o.clone(),o.channel=n.texCoord),r.extensions[$e.KHR_TEXTURE_TRANSFORM]){let a=n.extensions!==void 0?n.extensions[$e.KHR_TEXTURE_TRANSFORM]:void 0;if(a){let l=r.associations.get(o);o=r.extensions[$e.KHR_TEXTURE_TRANSFORM].extendTexture(o,a),r.associations.set(o,l)}}return i!==void 0&&(o.colorSpace=i),e[t]=o,o})}assignFinalMaterial(e){let t=e.geometry,n=e.material,i=t.attributes.tangent===void 0,r=t.attributes.color!==void 0,o=t.attributes.normal===void 0;if(e.isPoints){let a="PointsMaterial:"+n.uuid,l=this.cache.get(a);l||(l=new Wi,Yt.prototype.copy.call(l,n),l.color.copy(n.color),l.map=n.map,l.sizeAttenuation=!1,this.cache.add(a,l)),n=l}else if(e.isLine){let a="LineBasicMaterial:"+n.uuid,l=this.cache.get(a);l||(l=new Ot,Yt.prototype.copy.call(l,n),l.color.copy(n.color),l.map=n.map,this.cache.add(a,l)),n=l}if(i||r||o){let a="ClonedMaterial:"+n.uuid+":";i&&(a+="derivative-tangents:"),r&&(a+="vertex-colors:"),o&&(a+="flat-shading:");let l=this.cache.get(a);l||(l=n.clone(),r&&(l.vertexColors=!0),o&&(l.flatShading=!0),i&&(l.normalScale&&(l.normalScale.y*=-1),l.clearcoatNormalScale&&(l.clearcoatNormalScale.y*=-1)),this.cache.add(a,l),this.associations.set(l,this.associations.get(n))),n=l}e.material=n}getMaterialType(){return Mt}loadMaterial(e){let t=this,n=this.json,i=this.extensions,r=n.materials[e],o,a={},l=r.extensions||{},c=[];if(l[$e.KHR_MATERIALS_UNLIT]){let u=i[$e.KHR_MATERIALS_UNLIT];o=u.getMaterialType(),c.push(u.extendParams(a,r,t))}else{let u=r.pbrMetallicRoughness||{};if(a.color=new ve(1,1,1),a.opacity=1,Array.isArray(u.baseColorFactor)){let d=u.baseColorFactor;a.color.setRGB(d[0],d[1],d[2],an),a.opacity=d[3]}u.baseColorTexture!==void 0&&c.push(t.assignTexture(a,"map",u.baseColorTexture,ot)),a.metalness=u.metallicFactor!==void 0?u.metallicFactor:1,a.roughness=u.roughnessFactor!==void 0?u.roughnessFactor:1,u.metallicRoughnessTexture!==void 0&&(c.push(t.assignTexture(a,"metalnessMap",u.metallicRoughnessTexture)),c.push(t.assignTexture(a,"roughnessMap",u.metallicRoughnessTexture))),o=this._invokeOne(function(d){return d.getMaterialType&&d.getMaterialType(e)}),c.push(Promise.all(this._invokeAll(function(d){return d.extendMaterialParams&&d.extendMaterialParams(e,a)})))}r.doubleSided===!0&&(a.side=It);let h=r.alphaMode||Vu.OPAQUE;if(h===Vu.BLEND?(a.transparent=!0,a.depthWrite=!1):(a.transparent=!1,h===Vu.MASK&&(a.alphaTest=r.alphaCutoff!==void 0?r.alphaCutoff:.5)),r.normalTexture!==void 0&&o!==lt&&(c.push(t.assignTexture(a,"normalMap",r.normalTexture)),a.normalScale=new ye(1,1),r.normalTexture.scale!==void 0)){let u=r.normalTexture.scale;a.normalScale.set(u,u)}if(r.occlusionTexture!==void 0&&o!==lt&&(c.push(t.assignTexture(a,"aoMap",r.occlusionTexture)),r.occlusionTexture.strength!==void 0&&(a.aoMapIntensity=r.occlusionTexture.strength)),r.emissiveFactor!==void 0&&o!==lt){let u=r.emissiveFactor;a.emissive=new ve().setRGB(u[0],u[1],u[2],an)}return r.emissiveTexture!==void 0&&o!==lt&&c.push(t.assignTexture(a,"emissiveMap",r.emissiveTexture,ot)),Promise.all(c).then(function(){let u=new o(a);return r.name&&(u.name=r.name),ri(u,r),t.associations.set(u,{materials:e}),r.extensions&&Is(i,u,r),u})}createUniqueName(e){let t=ut.sanitizeNodeName(e||"");return t in this.nodeNamesUsed?t+"_"+ ++this.nodeNamesUsed[t]:(this.nodeNamesUsed[t]=0,t)}loadGeometries(e){let t=this,n=this.extensions,i=this.primitiveCache;function r(a){return n[$e.KHR_DRACO_MESH_COMPRESSION].decodePrimitive(a,t).then(function(l){return Vm(l,a,t)})}let o=[];for(let a=0,l=e.length;a<l;a++){let c=e[a],h=VM(c),u=i[h];if(u)o.push(u.promise);else{let d;c.extensions&&c.extensions[$e.KHR_DRACO_MESH_COMPRESSION]?d=r(c):d=Vm(new Ye,c,t),c.mode===Nn.TRIANGLE_STRIP?d=d.then(f=>Hu(f,Ro)):c.mode===Nn.TRIANGLE_FAN&&(d=d.then(f=>Hu(f,wr))),i[h]={primitive:c,promise:d},o.push(d)}}return Promise.all(o)}loadMesh(e){let t=this,n=this.json,i=this.extensions,r=n.meshes[e],o=r.primitives,a=[];for(let l=0,c=o.length;l<c;l++){let h=o[l].material===void 0?zM(this.cache):this.getDependency("material",o[l].material);a.push(h)}return a.push(t.loadGeometries(o)),Promise.all(a).then(async function(l){let c=l.slice(0,l.length-1),h=l[l.length-1],u=[];for(let f=0,g=h.length;f<g;f++){let y=h[f],p=o[f],m,b=c[f];if(p.mode===Nn.TRIANGLES||p.mode===Nn.TRIANGLE_STRIP||p.mode===Nn.TRIANGLE_FAN||p.mode===void 0){let E=r.isSkinnedMesh===!0,M=y.hasAttribute("skinIndex")&&y.hasAttribute("skinWeight");E&&M===!1&&console.warn("THREE.GLTFLoader: Missing skinIndex or skinWeight attributes. Skinning disabled."),m=E&&M?new no(y,b):new ue(y,b),m.isSkinnedMesh===!0&&m.normalizeSkinWeights()}else if(p.mode===Nn.LINES)m=new vn(y,b);else if(p.mode===Nn.LINE_STRIP)m=new In(y,b);else if(p.mode===Nn.LINE_LOOP)m=new so(y,b);else if(p.mode===Nn.POINTS)m=new ms(y,b);else throw new Error("THREE.GLTFLoader: Primitive mode unsupported: "+p.mode);Object.keys(m.geometry.morphAttributes).length>0&&GM(m,r),m.name=t.createUniqueName(r.name||"mesh_"+e),ri(m,r),p.extensions&&Is(i,m,p),t.assignFinalMaterial(m),u.push(m)}for(let f=0,g=u.length;f<g;f++)t.associations.set(u[f],{meshes:e,primitives:f});if(u.length===1)return r.extensions&&Is(i,u[0],r),u[0];let d=new Pe;r.extensions&&Is(i,d,r),t.associations.set(d,{meshes:e});for(let f=0,g=u.length;f<g;f++)d.add(u[f]);return d})}loadCamera(e){let t,n=this.json.cameras[e],i=n[n.type];if(!i){console.warn("THREE.GLTFLoader: Missing camera parameters.");return}return n.type==="perspective"?t=new dt(Ri.radToDeg(i.yfov),i.aspectRatio||1,i.znear||1,i.zfar||2e6):n.type==="orthographic"&&(t=new Gn(-i.xmag,i.xmag,i.ymag,-i.ymag,i.znear,i.zfar)),n.name&&(t.name=this.createUniqueName(n.name)),ri(t,n),Promise.resolve(t)}loadSkin(e){let t=this.json.skins[e],n=[];for(let i=0,r=t.joints.length;i<r;i++)n.push(this._loadNodeShallow(t.joints[i]));return t.inverseBindMatrices!==void 0?n.push(this.getDependency("accessor",t.inverseBindMatrices)):n.push(null),Promise.all(n).then(function(i){let r=i.pop(),o=i,a=[],l=[];for(let c=0,h=o.length;c<h;c++){let u=o[c];if(u){a.push(u);let d=new _e;r!==null&&d.fromArray(r.array,c*16),l.push(d)}else console.warn('THREE.GLTFLoader: Joint "%s" could not be found.',t.joints[c])}return new io(a,l)})}loadAnimation(e){let t=this.json,n=this,i=t.animations[e],r=i.name?i.name:"animation_"+e,o=[],a=[],l=[],c=[],h=[];for(let u=0,d=i.channels.length;u<d;u++){let f=i.channels[u],g=i.samplers[f.sampler],y=f.target,p=y.node,m=i.parameters!==void 0?i.parameters[g.input]:g.input,b=i.parameters!==void 0?i.parameters[g.output]:g.output;y.node!==void 0&&(o.push(this.getDependency("node",p)),a.push(this.getDependency("accessor",m)),l.push(this.getDependency("accessor",b)),c.push(g),h.push(y))}return Promise.all([Promise.all(o),Promise.all(a),Promise.all(l),Promise.all(c),Promise.all(h)]).then(function(u){let d=u[0],f=u[1],g=u[2],y=u[3],p=u[4],m=[];for(let E=0,M=d.length;E<M;E++){let R=d[E],T=f[E],x=g[E],w=y[E],O=p[E];if(R===void 0)continue;R.updateMatrix&&R.updateMatrix();let I=n._createAnimationTracks(R,T,x,w,O);if(I)for(let N=0;N<I.length;N++)m.push(I[N])}let b=new po(r,void 0,m);return ri(b,i),b})}createNodeMesh(e){let t=this.json,n=this,i=t.nodes[e];return i.mesh===void 0?null:n.getDependency("mesh",i.mesh).then(function(r){let o=n._getNodeRef(n.meshCache,i.mesh,r);return i.weights!==void 0&&o.traverse(function(a){if(a.isMesh)for(let l=0,c=i.weights.length;l<c;l++)a.morphTargetInfluences[l]=i.weights[l]}),o})}loadNode(e){let t=this.json,n=this,i=t.nodes[e],r=n._loadNodeShallow(e),o=[],a=i.children||[];for(let c=0,h=a.length;c<h;c++)o.push(n.getDependency("node",a[c]));let l=i.skin===void 0?Promise.resolve(null):n.getDependency("skin",i.skin);return Promise.all([r,Promise.all(o),l]).then(function(c){let h=c[0],u=c[1],d=c[2];d!==null&&h.traverse(function(f){f.isSkinnedMesh&&f.bind(d,XM)});for(let f=0,g=u.length;f<g;f++)h.add(u[f]);if(h.userData.pivot!==void 0&&u.length>0){let f=h.userData.pivot,g=u[0];h.pivot=new S().fromArray(f),h.position.x-=f[0],h.position.y-=f[1],h.position.z-=f[2],g.position.set(0,0,0),delete h.userData.pivot}return h})}_loadNodeShallow(e){let t=this.json,n=this.extensions,i=this;if(this.nodeCache[e]!==void 0)return this.nodeCache[e];let r=t.nodes[e],o=r.name?i.createUniqueName(r.name):"",a=[],l=i._invokeOne(function(c){return c.createNodeMesh&&c.createNodeMesh(e)});return l&&a.push(l),r.camera!==void 0&&a.push(i.getDependency("camera",r.camera).then(function(c){return i._getNodeRef(i.cameraCache,r.camera,c)})),i._invokeAll(function(c){return c.createNodeAttachment&&c.createNodeAttachment(e)}).forEach(function(c){a.push(c)}),this.nodeCache[e]=Promise.all(a).then(function(c){let h;if(r.isBone===!0?h=new ur:c.length>1?h=new Pe:c.length===1?h=c[0]:h=new it,h!==c[0])for(let u=0,d=c.length;u<d;u++)h.add(c[u]);if(r.name&&(h.userData.name=r.name,h.name=o),ri(h,r),r.extensions&&Is(n,h,r),r.matrix!==void 0){let u=new _e;u.fromArray(r.matrix),h.applyMatrix4(u)}else r.translation!==void 0&&h.position.fromArray(r.translation),r.rotation!==void 0&&h.quaternion.fromArray(r.rotation),r.scale!==void 0&&h.scale.fromArray(r.scale);if(!i.associations.has(h))i.associations.set(h,{});else if(r.mesh!==void 0&&i.meshCache.refs[r.mesh]>1){let u=i.associations.get(h);i.associations.set(h,{...u})}return i.associations.get(h).nodes=e,h}),this.nodeCache[e]}loadScene(e){let t=this.extensions,n=this.json.scenes[e],i=this,r=new Pe;n.name&&(r.name=i.createUniqueName(n.name)),ri(r,n),n.extensions&&Is(t,r,n);let o=n.nodes||[],a=[];for(let l=0,c=o.length;l<c;l++)a.push(i.getDependency("node",o[l]));return Promise.all(a).then(function(l){for(let h=0,u=l.length;h<u;h++){let d=l[h];d.parent!==null?r.add(km(d)):r.add(d)}let c=h=>{let u=new Map;for(let[d,f]of i.associations)(d instanceof Yt||d instanceof Nt)&&u.set(d,f);return h.traverse(d=>{let f=i.associations.get(d);f!=null&&u.set(d,f)}),u};return i.associations=c(r),r})}_createAnimationTracks(e,t,n,i,r){let o=[],a=e.name?e.name:e.uuid,l=[];function c(f){f.morphTargetInfluences&&l.push(f.name?f.name:f.uuid)}es[r.path]===es.weights?(c(e),e.isGroup&&e.children.forEach(c)):l.push(a);let h;switch(es[r.path]){case es.weights:h=wi;break;case es.rotation:h=Si;break;case es.translation:case es.scale:h=$i;break;default:n.itemSize===1?h=wi:h=$i;break}let u=i.interpolation!==void 0?BM[i.interpolation]:ds,d=this._getArrayFromAccessor(n);for(let f=0,g=l.length;f<g;f++){let y=new h(l[f]+"."+es[r.path],t.array,d,u);i.interpolation==="CUBICSPLINE"&&this._createCubicSplineTrackInterpolant(y),o.push(y)}return o}_getArrayFromAccessor(e){let t=e.array;if(e.normalized){let n=md(t.constructor),i=new Float32Array(t.length);for(let r=0,o=t.length;r<o;r++)i[r]=t[r]*n;t=i}return t}_createCubicSplineTrackInterpolant(e){e.createInterpolant=function(n){let i=this instanceof Si?fd:oc;return new i(this.times,this.values,this.getValueSize()/3,n)},e.createInterpolant.isInterpolantFactoryMethodGLTFCubicSpline=!0}};function qM(s,e,t){let n=e.attributes,i=new vt;if(n.POSITION!==void 0){let a=t.json.accessors[n.POSITION],l=a.min,c=a.max;if(l!==void 0&&c!==void 0){if(i.set(new S(l[0],l[1],l[2]),new S(c[0],c[1],c[2])),a.normalized){let h=md(Lr[a.componentType]);i.min.multiplyScalar(h),i.max.multiplyScalar(h)}}else{console.warn("THREE.GLTFLoader: Missing min/max properties for accessor POSITION.");return}}else return;let r=e.targets;if(r!==void 0){let a=new S,l=new S;for(let c=0,h=r.length;c<h;c++){let u=r[c];if(u.POSITION!==void 0){let d=t.json.accessors[u.POSITION],f=d.min,g=d.max;if(f!==void 0&&g!==void 0){if(l.setX(Math.max(Math.abs(f[0]),Math.abs(g[0]))),l.setY(Math.max(Math.abs(f[1]),Math.abs(g[1]))),l.setZ(Math.max(Math.abs(f[2]),Math.abs(g[2]))),d.normalized){let y=md(Lr[d.componentType]);l.multiplyScalar(y)}a.max(l)}else console.warn("THREE.GLTFLoader: Missing min/max properties for accessor POSITION.")}}i.expandByVector(a)}s.boundingBox=i;let o=new un;i.getCenter(o.center),o.radius=i.min.distanceTo(i.max)/2,s.boundingSphere=o}function Vm(s,e,t){let n=e.attributes,i=[];function r(o,a){return t.getDependency("accessor",o).then(function(l){s.setAttribute(a,l)})}for(let o in n){let a=pd[o]||o.toLowerCase();a in s.attributes||i.push(r(n[o],a))}if(e.indices!==void 0&&!s.index){let o=t.getDependency("accessor",e.indices).then(function(a){s.setIndex(a)});i.push(o)}return Xe.workingColorSpace!==an&&"COLOR_0"in n&&console.warn(`THREE.GLTFLoader: Converting vertex colors from "srgb-linear" to "${Xe.workingColorSpace}" not supported.`),ri(s,e),qM(s,e,t),Promise.all(i).then(function(){return e.targets!==void 0?HM(s,e.targets,t):s})}var Xm={playing:!1,time:0,duration:0,speed:1,loop:!0,protocol:null,phases:[],phase:"",holder:null,reason:"",gap_m:null,residual_m:null,residual_rad:null,scope:null,rcm:null,rcm_error_m:null,depth_m:null,trocars:[],variant:null,distances:[],planning:null,workspace:!1,postures:[]};var $m=6e3,$M=new Set(["protocol","posture","undo","grab","drag","release","variant","distance","workspace"]),ac=class{constructor(e){this.page=e}page;info=null;state={...Xm};frame=null;holding=!1;refusedAt=-1/0;stopped="";take(e){let t=this.frame?.flags??0;this.frame=e,e.flags&4&&(e.flags&8||!(t&4))&&(this.refusedAt=performance.now())}get refused(){return this.frame!==null&&(this.frame.flags&4)!==0}get heldByOther(){return this.frame!==null&&(this.frame.flags&8)!==0&&!this.holding&&this.state.holder!==null&&this.state.holder!==this.page.client}get called(){return this.page.several?this.info?.name??"":"the robot"}protocol(){let e=this.info?.protocols.find(t=>t.is_default)??this.info?.protocols[0];return this.state.protocol??this.state.planning??e?.name??""}joint(e){let n=(this.info?.joints.filter(i=>i.active)??[]).findIndex(i=>i.name===e);return n<0||!this.frame?NaN:this.frame.q[n]??NaN}fields(e,t){return this.page.several&&$M.has(e)?{robot:this.info?.name,...t}:t}say(e){this.page.say(e)}},lc=class{scene=null;robots=[new ac(this)];chosen=0;line="connecting";client=null;leaving=!1;failure="";onChange=()=>{};console=null;atConsole=()=>null;hint=()=>"";news=null;newest=null;hash="";said="";saidAt=-1/0;get robot(){return this.robots[this.chosen]}get info(){return this.robot.info}get state(){return this.robot.state}get frame(){return this.robot.frame}get refused(){return this.robot.refused}get heldByOther(){return this.robot.heldByOther}joint(e){return this.robot.joint(e)}get several(){return this.robots.length>1}get time(){return this.newest?.time??this.state.time}meet(e){for(this.scene=e;this.robots.length<e.robots.length;)this.robots.push(new ac(this));e.robots.forEach((t,n)=>this.robots[n].info=t),this.check(),this.news&&this.hear(this.news),this.newest&&this.take(this.newest),this.onChange()}named(e){return e===void 0?0:this.robots.findIndex(t=>t.info?.name===e)}hear(e){if(e.type==="hello")this.client=e.client,this.hash=e.model_hash,this.check();else if(e.type==="state"){this.news=e;let{type:t,robots:n,console:i,...r}=e;this.console=i??null,this.leaving=i?.leaving??!1;for(let o of this.robots){let a=n?.find(l=>l.name===o.info?.name);o.state={...o.state,...a,...r},o.holding&&o.state.reason&&(o.stopped=o.state.reason),o.state.playing&&(o.stopped="")}}else e.type==="error"&&this.say(e.message);e.type!=="pong"&&this.onChange()}check(){!this.scene||!this.hash||this.hash===this.scene.model_hash||(this.scene.console?.guided?window.location.reload():this.failure="The server now shows other content. Reload this page.")}say(e){this.said=e,this.saidAt=performance.now(),this.onChange()}take(e){this.newest=e,this.robots.forEach((t,n)=>{let i=e.robots[n];i&&t.take(i)})}status(){let e=this.state;if(this.failure)return{tone:"bad",text:this.failure};if(this.line==="refused")return{tone:"bad",text:"Access denied: open the address with the token that twin serve prints on its terminal."};if(this.leaving)return{tone:"good",text:"The scene is being prepared: this page then shows it by itself."};if(this.line==="reconnecting")return{tone:"warn",text:"Connection lost: reconnecting \u2026 Nothing moves until the server answers."};if(this.line==="connecting")return{tone:"plain",text:"Connecting \u2026"};if(this.refused&&e.reason&&performance.now()-this.robot.refusedAt<$m)return{tone:"bad",text:`Target not reached: ${e.reason}`};let t=this.said.startsWith(this.console?.task?.over??"\0");if(performance.now()-this.saidAt<$m&&!t)return{tone:"warn",text:this.said};let n=this.atConsole();if(n)return n;let i=this.robots.find(c=>c.state.machine?.problem);if(i&&!e.playing)return{tone:"bad",text:`Machine of ${i.called}: ${i.state.machine?.problem}.`};let r=this.robots.find(c=>c.heldByOther);if(r)return{tone:"warn",text:`Client ${r.state.holder} holds ${r.called}.`};let o=this.robots.find(c=>c.holding);if(o)return{tone:"good",text:`You hold ${o.called}.`};let a=this.hint();if(a)return{tone:"good",text:a};let l=this.robots.filter(c=>c.state.planning);return l.length?{tone:"plain",text:this.several?`Planning: ${l.map(c=>c.info?.name).join(", ")} \u2026`:"Planning the protocol \u2026"}:this.robot.stopped?{tone:"warn",text:`The last drag stopped: ${this.robot.stopped}`}:e.playing&&e.phase?{tone:"plain",text:`Playing: ${e.phase}`}:{tone:"plain",text:"Ready."}}};function Wt(s){let e=Math.abs(s);return Number.isFinite(s)?e<5e-9?"< 0.01 \xB5m":e<99995e-8?`${(1e6*s).toFixed(e<99995e-10?2:1)} \xB5m`:e<1?`${(1e3*s).toFixed(2)} mm`:`${s.toFixed(3)} m`:"\u2013"}var YM=1e-9;function ko(s,e=!1){return Math.abs(s)<YM?"exact":e?Ls(s,!0):Wt(s)}function Ls(s,e){if(!Number.isFinite(s))return"\u2013";let t=((e?180/Math.PI:1e3)*s).toFixed(2).replace(/^-(?=0\.00$)/,"");return e?`${t}\xB0`:`${t} mm`}function ts(s){return s.unit==="rad"||s.unit==="deg"||s.type==="revolute"}function Ym(s,e){return[s.x,s.y,s.z,e.x,e.y,e.z,e.w]}var Km=new Map;function oi(s){let e=Km.get(s);return e||(e=new Dr().loadAsync(s),Km.set(s,e)),e}function jm(){for(let s of document.querySelectorAll("link[rel=preload]")){let e=s.getAttribute("href")??"";e.endsWith(".glb")&&oi(e).catch(()=>{})}}var KM=400,Zm=14162730,jM=2981856,ZM=.32,JM=35,cc=class s{links=new Map;root;outline=null;marked=["","none"];bright=!1;veiled=!1;edges=[];edged=!1;constructor(e){this.root=e.children.length===1&&e.children[0]?e.children[0]:e}static async load(e){let t=await oi(`${e.files}robot.glb`),n=new s(t.scene),i=new Map;t.scene.traverse(o=>{let a=o.userData.link??o.userData.name??o.name;typeof a=="string"&&!i.has(a)&&i.set(a,o)});let r=e.links.filter(o=>!i.has(o));if(r.length)throw new Error(`The robot's GLB file lacks the links ${r.join(", ")}.`);for(let o of e.links)n.links.set(o,ew(o,i.get(o)));return n}apply(e,t){let n=e.poses;t.forEach((i,r)=>{let o=this.links.get(i)?.node;o&&(o.position.fromArray(n,7*r),o.quaternion.fromArray(n,7*r+3))}),this.root.updateMatrixWorld(!0)}hide(e){for(let t of this.links.values())t.node.visible=!e.includes(t.name)}box(){this.root.updateMatrixWorld(!0);let e=new _e().copy(this.root.matrixWorld).invert(),t=new vt;for(let n of this.links.values())for(let i of n.points)t.expandByPoint(i.clone().applyMatrix4(n.node.matrixWorld).applyMatrix4(e));return t}targets(){return[...this.links.values()].flatMap(e=>e.skins.map(t=>t.mesh))}linkOf(e){for(let t=e;t;t=t.parent){let n=t.userData.twinLink;if(typeof n=="string")return n}return null}nearest(e){let t=null,n=new S;for(let i of this.links.values())for(let r of i.points){let o=n.copy(r).applyMatrix4(i.node.matrixWorld).distanceTo(e);(!t||o<t.distance)&&(t={link:i.name,distance:o})}return t}mark(e,t){if(this.marked[0]===e&&this.marked[1]===t)return!1;this.marked=[e,t],this.outline?.removeFromParent(),this.outline=null;for(let i of this.links.values())this.tint(i);let n=this.links.get(e);return n&&t==="refused"&&(this.outline=tw(n),n.node.add(this.outline)),!0}brighten(e){this.bright=e;for(let t of this.links.values())this.tint(t)}veil(e){this.veiled=e;for(let t of this.edges)t.visible=this.edged&&!e;for(let t of this.links.values()){this.tint(t);for(let{mesh:n,material:i,opacity:r}of t.skins)i.transparent=e||r<1,i.depthWrite=!i.transparent,i.polygonOffset=e,i.polygonOffsetFactor=i.polygonOffsetUnits=2,i.needsUpdate=!0,n.castShadow=!i.transparent}}outlineAll(e){if(e&&!this.edges.length)for(let{node:t,skins:n}of this.links.values()){let i=n.filter(({material:o})=>!o.transparent);if(!i.length)continue;let r=Jm(t,i,new Ot({color:1317409,transparent:!0,opacity:.42}));this.edges.push(r),t.add(r)}this.edged=e;for(let t of this.edges)t.visible=e&&!this.veiled}paint(e,t=0){let n=t;for(let i of this.links.values()){let r=new lt({color:QM(n++),toneMapped:!1});for(let o of i.skins)o.mesh.material=e?r:o.material}}copyOf(e,t,n){let i=new Pe,r=this.links.get(e);if(!r)return i;let o=new Mt({color:t,opacity:n,transparent:!0,depthWrite:!1});r.node.updateWorldMatrix(!0,!1);let a=new _e().copy(r.node.matrixWorld).invert();for(let{mesh:l}of r.skins){l.updateWorldMatrix(!0,!1);let c=new ue(l.geometry,o);c.applyMatrix4(new _e().multiplyMatrices(a,l.matrixWorld)),i.add(c)}return i}tint(e){let t=this.marked[0]===e.name?this.marked[1]:"none",n={none:0,hover:1855375,held:1271510,refused:Zm}[t];for(let{material:i,color:r,opacity:o}of e.skins){if(i.color.copy(r),i.emissive.setHex(n),i.emissiveIntensity=t==="hover"?.35:.5,this.bright){let a={h:0,s:0,l:0};r.getHSL(a),i.color.setHSL(a.h,a.s,.5+.4*a.l),t==="none"&&i.emissive.copy(i.color).multiplyScalar(.18),i.emissiveIntensity=1}i.opacity=this.veiled?ZM:o,this.veiled&&i.color.setHex(jM)}}};function QM(s){let e=(s*37+7)%125,t=n=>15+60*(n%5);return new ve().setStyle(`rgb(${t(e)},${t(Math.floor(e/5))},${t(Math.floor(e/25))})`)}function ew(s,e){let t=[],n=[];e.userData.twinLink=s,e.updateWorldMatrix(!0,!0);let i=new _e().copy(e.matrixWorld).invert();return e.traverse(r=>{if(!(r instanceof ue))return;let o=r,l=o.material.clone();l.userData={...l.userData,metalness:l.metalness},l.metalness=Math.min(l.metalness,.15),l.userData.dullness=l.metalness,l.roughness=Math.max(.42,Math.min(l.roughness,.6)),l.depthWrite=!l.transparent,o.material=l,o.castShadow=!l.transparent,o.receiveShadow=!0,t.push({mesh:o,material:l,color:l.color.clone(),opacity:l.opacity});let c=new _e().multiplyMatrices(i,o.matrixWorld),h=o.geometry.getAttribute("position"),u=Math.max(1,Math.floor(h.count/KM));for(let d=0;d<h.count;d+=u)n.push(new S().fromBufferAttribute(h,d).applyMatrix4(c))}),{name:s,node:e,skins:t,points:n}}function Jm(s,e,t){s.updateWorldMatrix(!0,!0);let n=new _e().copy(s.matrixWorld).invert(),i=[],r=new S;for(let{mesh:a}of e){let l=new _e().multiplyMatrices(n,a.matrixWorld),c=new lo(a.geometry,JM).getAttribute("position");for(let h=0;h<c.count;h++)i.push(...r.fromBufferAttribute(c,h).applyMatrix4(l).toArray())}let o=new vn(void 0,t);return o.geometry.setAttribute("position",new Ue(i,3)),o}function tw(s){let e=new Ot({color:Zm,depthTest:!1,toneMapped:!1}),t=Jm(s.node,s.skins,e);return t.renderOrder=5,t.userData.twinLink=s.name,t}function Mn(s){return{p:new S(s[0],s[1],s[2]),q:new De(s[3],s[4],s[5],s[6])}}function yd(s){let{p:e,q:t}=Mn(s);return new _e().compose(e,t,new S(1,1,1))}var Qm={type:"change"},_d={type:"start"},tg={type:"end"},hc=new Zn,eg=new $t,nw=Math.cos(70*Ri.DEG2RAD),kt=new S,gn=2*Math.PI,tt={NONE:-1,ROTATE:0,DOLLY:1,PAN:2,TOUCH_ROTATE:3,TOUCH_PAN:4,TOUCH_DOLLY_PAN:5,TOUCH_DOLLY_ROTATE:6},vd=1e-6,uc=class extends _o{constructor(e,t=null){super(e,t),this.state=tt.NONE,this.target=new S,this.cursor=new S,this.minDistance=0,this.maxDistance=1/0,this.minZoom=0,this.maxZoom=1/0,this.minTargetRadius=0,this.maxTargetRadius=1/0,this.minPolarAngle=0,this.maxPolarAngle=Math.PI,this.minAzimuthAngle=-1/0,this.maxAzimuthAngle=1/0,this.enableDamping=!1,this.dampingFactor=.05,this.enableZoom=!0,this.zoomSpeed=1,this.enableRotate=!0,this.rotateSpeed=1,this.keyRotateSpeed=1,this.enablePan=!0,this.panSpeed=1,this.screenSpacePanning=!0,this.keyPanSpeed=7,this.zoomToCursor=!1,this.autoRotate=!1,this.autoRotateSpeed=2,this.keys={LEFT:"ArrowLeft",UP:"ArrowUp",RIGHT:"ArrowRight",BOTTOM:"ArrowDown"},this.mouseButtons={LEFT:ji.ROTATE,MIDDLE:ji.DOLLY,RIGHT:ji.PAN},this.touches={ONE:Zi.ROTATE,TWO:Zi.DOLLY_PAN},this.target0=this.target.clone(),this.position0=this.object.position.clone(),this.zoom0=this.object.zoom,this._cursorStyle="auto",this._domElementKeyEvents=null,this._lastPosition=new S,this._lastQuaternion=new De,this._lastTargetPosition=new S,this._quat=new De().setFromUnitVectors(e.up,new S(0,1,0)),this._quatInverse=this._quat.clone().invert(),this._spherical=new xr,this._sphericalDelta=new xr,this._scale=1,this._panOffset=new S,this._rotateStart=new ye,this._rotateEnd=new ye,this._rotateDelta=new ye,this._panStart=new ye,this._panEnd=new ye,this._panDelta=new ye,this._dollyStart=new ye,this._dollyEnd=new ye,this._dollyDelta=new ye,this._dollyDirection=new S,this._mouse=new ye,this._performCursorZoom=!1,this._pointers=[],this._pointerPositions={},this._controlActive=!1,this._onPointerMove=sw.bind(this),this._onPointerDown=iw.bind(this),this._onPointerUp=rw.bind(this),this._onContextMenu=dw.bind(this),this._onMouseWheel=lw.bind(this),this._onKeyDown=cw.bind(this),this._onTouchStart=hw.bind(this),this._onTouchMove=uw.bind(this),this._onMouseDown=ow.bind(this),this._onMouseMove=aw.bind(this),this._interceptControlDown=fw.bind(this),this._interceptControlUp=pw.bind(this),this.domElement!==null&&this.connect(this.domElement),this.update()}set cursorStyle(e){this._cursorStyle=e,e==="grab"?this.domElement.style.cursor="grab":this.domElement.style.cursor="auto"}get cursorStyle(){return this._cursorStyle}connect(e){super.connect(e),this.domElement.addEventListener("pointerdown",this._onPointerDown),this.domElement.addEventListener("pointercancel",this._onPointerUp),this.domElement.addEventListener("contextmenu",this._onContextMenu),this.domElement.addEventListener("wheel",this._onMouseWheel,{passive:!1}),this.domElement.ownerDocument.addEventListener("keydown",this._interceptControlDown,{passive:!0,capture:!0}),this.domElement.style.touchAction="none"}disconnect(){this.state=tt.NONE,this.domElement.removeEventListener("pointerdown",this._onPointerDown),this.domElement.ownerDocument.removeEventListener("pointermove",this._onPointerMove),this.domElement.ownerDocument.removeEventListener("pointerup",this._onPointerUp),this.domElement.removeEventListener("pointercancel",this._onPointerUp),this.domElement.removeEventListener("wheel",this._onMouseWheel),this.domElement.removeEventListener("contextmenu",this._onContextMenu),this.stopListenToKeyEvents(),this.domElement.ownerDocument.removeEventListener("keydown",this._interceptControlDown,{capture:!0}),this.domElement.ownerDocument.removeEventListener("keyup",this._interceptControlUp,{capture:!0}),this._controlActive=!1,this._pointers.length=0,this._pointerPositions={},this.domElement.style.touchAction="",this.domElement.style.cursor="auto"}dispose(){this.disconnect()}getPolarAngle(){return this._spherical.phi}getAzimuthalAngle(){return this._spherical.theta}getDistance(){return this.object.position.distanceTo(this.target)}listenToKeyEvents(e){e.addEventListener("keydown",this._onKeyDown),this._domElementKeyEvents=e}stopListenToKeyEvents(){this._domElementKeyEvents!==null&&(this._domElementKeyEvents.removeEventListener("keydown",this._onKeyDown),this._domElementKeyEvents=null)}saveState(){this.target0.copy(this.target),this.position0.copy(this.object.position),this.zoom0=this.object.zoom}reset(){this.target.copy(this.target0),this.object.position.copy(this.position0),this.object.zoom=this.zoom0,this.object.updateProjectionMatrix(),this.dispatchEvent(Qm),this.update(),this.state=tt.NONE}pan(e,t){this._pan(e,t),this.update()}dollyIn(e){this._dollyIn(e),this.update()}dollyOut(e){this._dollyOut(e),this.update()}rotateLeft(e){this._rotateLeft(e),this.update()}rotateUp(e){this._rotateUp(e),this.update()}update(e=null){let t=this.object.position;kt.copy(t).sub(this.target),kt.applyQuaternion(this._quat),this._spherical.setFromVector3(kt),this.autoRotate&&this.state===tt.NONE&&this._rotateLeft(this._getAutoRotationAngle(e)),this.enableDamping?(this._spherical.theta+=this._sphericalDelta.theta*this.dampingFactor,this._spherical.phi+=this._sphericalDelta.phi*this.dampingFactor):(this._spherical.theta+=this._sphericalDelta.theta,this._spherical.phi+=this._sphericalDelta.phi);let n=this.minAzimuthAngle,i=this.maxAzimuthAngle;isFinite(n)&&isFinite(i)&&(n<-Math.PI?n+=gn:n>Math.PI&&(n-=gn),i<-Math.PI?i+=gn:i>Math.PI&&(i-=gn),n<=i?this._spherical.theta=Math.max(n,Math.min(i,this._spherical.theta)):this._spherical.theta=this._spherical.theta>(n+i)/2?Math.max(n,this._spherical.theta):Math.min(i,this._spherical.theta)),this._spherical.phi=Math.max(this.minPolarAngle,Math.min(this.maxPolarAngle,this._spherical.phi)),this._spherical.makeSafe(),this.enableDamping===!0?this.target.addScaledVector(this._panOffset,this.dampingFactor):this.target.add(this._panOffset),this.target.sub(this.cursor),this.target.clampLength(this.minTargetRadius,this.maxTargetRadius),this.target.add(this.cursor);let r=!1;if(this.zoomToCursor&&this._performCursorZoom||this.object.isOrthographicCamera)this._spherical.radius=this._clampDistance(this._spherical.radius);else{let o=this._spherical.radius;this._spherical.radius=this._clampDistance(this._spherical.radius*this._scale),r=o!=this._spherical.radius}if(kt.setFromSpherical(this._spherical),kt.applyQuaternion(this._quatInverse),t.copy(this.target).add(kt),this.object.lookAt(this.target),this.enableDamping===!0?(this._sphericalDelta.theta*=1-this.dampingFactor,this._sphericalDelta.phi*=1-this.dampingFactor,this._panOffset.multiplyScalar(1-this.dampingFactor)):(this._sphericalDelta.set(0,0,0),this._panOffset.set(0,0,0)),this.zoomToCursor&&this._performCursorZoom){let o=null;if(this.object.isPerspectiveCamera){let a=kt.length();o=this._clampDistance(a*this._scale);let l=a-o;this.object.position.addScaledVector(this._dollyDirection,l),this.object.updateMatrixWorld(),r=!!l}else if(this.object.isOrthographicCamera){let a=new S(this._mouse.x,this._mouse.y,0);a.unproject(this.object);let l=this.object.zoom;this.object.zoom=Math.max(this.minZoom,Math.min(this.maxZoom,this.object.zoom/this._scale)),this.object.updateProjectionMatrix(),r=l!==this.object.zoom;let c=new S(this._mouse.x,this._mouse.y,0);c.unproject(this.object),this.object.position.sub(c).add(a),this.object.updateMatrixWorld(),o=kt.length()}else console.warn("WARNING: OrbitControls.js encountered an unknown camera type - zoom to cursor disabled."),this.zoomToCursor=!1;o!==null&&(this.screenSpacePanning?this.target.set(0,0,-1).transformDirection(this.object.matrix).multiplyScalar(o).add(this.object.position):(hc.origin.copy(this.object.position),hc.direction.set(0,0,-1).transformDirection(this.object.matrix),Math.abs(this.object.up.dot(hc.direction))<nw?this.object.lookAt(this.target):(eg.setFromNormalAndCoplanarPoint(this.object.up,this.target),hc.intersectPlane(eg,this.target))))}else if(this.object.isOrthographicCamera){let o=this.object.zoom;this.object.zoom=Math.max(this.minZoom,Math.min(this.maxZoom,this.object.zoom/this._scale)),o!==this.object.zoom&&(this.object.updateProjectionMatrix(),r=!0)}return this._scale=1,this._performCursorZoom=!1,r||this._lastPosition.distanceToSquared(this.object.position)>vd||8*(1-this._lastQuaternion.dot(this.object.quaternion))>vd||this._lastTargetPosition.distanceToSquared(this.target)>vd?(this.dispatchEvent(Qm),this._lastPosition.copy(this.object.position),this._lastQuaternion.copy(this.object.quaternion),this._lastTargetPosition.copy(this.target),!0):!1}_getAutoRotationAngle(e){return e!==null?gn/60*this.autoRotateSpeed*e:gn/60/60*this.autoRotateSpeed}_getZoomScale(e){let t=Math.abs(e*.01);return Math.pow(.95,this.zoomSpeed*t)}_rotateLeft(e){this._sphericalDelta.theta-=e}_rotateUp(e){this._sphericalDelta.phi-=e}_panLeft(e,t){kt.setFromMatrixColumn(t,0),kt.multiplyScalar(-e),this._panOffset.add(kt)}_panUp(e,t){this.screenSpacePanning===!0?kt.setFromMatrixColumn(t,1):(kt.setFromMatrixColumn(t,0),kt.crossVectors(this.object.up,kt)),kt.multiplyScalar(e),this._panOffset.add(kt)}_pan(e,t){let n=this.domElement;if(this.object.isPerspectiveCamera){let i=this.object.position;kt.copy(i).sub(this.target);let r=kt.length();r*=Math.tan(this.object.fov/2*Math.PI/180),this._panLeft(2*e*r/n.clientHeight,this.object.matrix),this._panUp(2*t*r/n.clientHeight,this.object.matrix)}else this.object.isOrthographicCamera?(this._panLeft(e*(this.object.right-this.object.left)/this.object.zoom/n.clientWidth,this.object.matrix),this._panUp(t*(this.object.top-this.object.bottom)/this.object.zoom/n.clientHeight,this.object.matrix)):(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - pan disabled."),this.enablePan=!1)}_dollyOut(e){this.object.isPerspectiveCamera||this.object.isOrthographicCamera?this._scale/=e:(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - dolly/zoom disabled."),this.enableZoom=!1)}_dollyIn(e){this.object.isPerspectiveCamera||this.object.isOrthographicCamera?this._scale*=e:(console.warn("WARNING: OrbitControls.js encountered an unknown camera type - dolly/zoom disabled."),this.enableZoom=!1)}_updateZoomParameters(e,t){if(!this.zoomToCursor)return;this._performCursorZoom=!0;let n=this.domElement.getBoundingClientRect(),i=e-n.left,r=t-n.top,o=n.width,a=n.height;this._mouse.x=i/o*2-1,this._mouse.y=-(r/a)*2+1,this._dollyDirection.set(this._mouse.x,this._mouse.y,1).unproject(this.object).sub(this.object.position).normalize()}_clampDistance(e){return Math.max(this.minDistance,Math.min(this.maxDistance,e))}_handleMouseDownRotate(e){this._rotateStart.set(e.clientX,e.clientY)}_handleMouseDownDolly(e){this._updateZoomParameters(e.clientX,e.clientY),this._dollyStart.set(e.clientX,e.clientY)}_handleMouseDownPan(e){this._panStart.set(e.clientX,e.clientY)}_handleMouseMoveRotate(e){this._rotateEnd.set(e.clientX,e.clientY),this._rotateDelta.subVectors(this._rotateEnd,this._rotateStart).multiplyScalar(this.rotateSpeed);let t=this.domElement;this._rotateLeft(gn*this._rotateDelta.x/t.clientHeight),this._rotateUp(gn*this._rotateDelta.y/t.clientHeight),this._rotateStart.copy(this._rotateEnd),this.update()}_handleMouseMoveDolly(e){this._dollyEnd.set(e.clientX,e.clientY),this._dollyDelta.subVectors(this._dollyEnd,this._dollyStart),this._dollyDelta.y>0?this._dollyOut(this._getZoomScale(this._dollyDelta.y)):this._dollyDelta.y<0&&this._dollyIn(this._getZoomScale(this._dollyDelta.y)),this._dollyStart.copy(this._dollyEnd),this.zoomToCursor&&(this._performCursorZoom=!0,this._dollyDirection.set(this._mouse.x,this._mouse.y,1).unproject(this.object).sub(this.object.position).normalize()),this.update()}_handleMouseMovePan(e){this._panEnd.set(e.clientX,e.clientY),this._panDelta.subVectors(this._panEnd,this._panStart).multiplyScalar(this.panSpeed),this._pan(this._panDelta.x,this._panDelta.y),this._panStart.copy(this._panEnd),this.update()}_handleMouseWheel(e){this._updateZoomParameters(e.clientX,e.clientY),e.deltaY<0?this._dollyIn(this._getZoomScale(e.deltaY)):e.deltaY>0&&this._dollyOut(this._getZoomScale(e.deltaY)),this.update()}_handleKeyDown(e){let t=!1;switch(e.code){case this.keys.UP:e.ctrlKey||e.metaKey||e.shiftKey?this.enableRotate&&this._rotateUp(gn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(0,this.keyPanSpeed),t=!0;break;case this.keys.BOTTOM:e.ctrlKey||e.metaKey||e.shiftKey?this.enableRotate&&this._rotateUp(-gn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(0,-this.keyPanSpeed),t=!0;break;case this.keys.LEFT:e.ctrlKey||e.metaKey||e.shiftKey?this.enableRotate&&this._rotateLeft(gn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(this.keyPanSpeed,0),t=!0;break;case this.keys.RIGHT:e.ctrlKey||e.metaKey||e.shiftKey?this.enableRotate&&this._rotateLeft(-gn*this.keyRotateSpeed/this.domElement.clientHeight):this.enablePan&&this._pan(-this.keyPanSpeed,0),t=!0;break}t&&(e.preventDefault(),this.update())}_handleTouchStartRotate(e){if(this._pointers.length===1)this._rotateStart.set(e.pageX,e.pageY);else{let t=this._getSecondPointerPosition(e),n=.5*(e.pageX+t.x),i=.5*(e.pageY+t.y);this._rotateStart.set(n,i)}}_handleTouchStartPan(e){if(this._pointers.length===1)this._panStart.set(e.pageX,e.pageY);else{let t=this._getSecondPointerPosition(e),n=.5*(e.pageX+t.x),i=.5*(e.pageY+t.y);this._panStart.set(n,i)}}_handleTouchStartDolly(e){let t=this._getSecondPointerPosition(e),n=e.pageX-t.x,i=e.pageY-t.y,r=Math.sqrt(n*n+i*i);this._dollyStart.set(0,r)}_handleTouchStartDollyPan(e){this.enableZoom&&this._handleTouchStartDolly(e),this.enablePan&&this._handleTouchStartPan(e)}_handleTouchStartDollyRotate(e){this.enableZoom&&this._handleTouchStartDolly(e),this.enableRotate&&this._handleTouchStartRotate(e)}_handleTouchMoveRotate(e){if(this._pointers.length==1)this._rotateEnd.set(e.pageX,e.pageY);else{let n=this._getSecondPointerPosition(e),i=.5*(e.pageX+n.x),r=.5*(e.pageY+n.y);this._rotateEnd.set(i,r)}this._rotateDelta.subVectors(this._rotateEnd,this._rotateStart).multiplyScalar(this.rotateSpeed);let t=this.domElement;this._rotateLeft(gn*this._rotateDelta.x/t.clientHeight),this._rotateUp(gn*this._rotateDelta.y/t.clientHeight),this._rotateStart.copy(this._rotateEnd)}_handleTouchMovePan(e){if(this._pointers.length===1)this._panEnd.set(e.pageX,e.pageY);else{let t=this._getSecondPointerPosition(e),n=.5*(e.pageX+t.x),i=.5*(e.pageY+t.y);this._panEnd.set(n,i)}this._panDelta.subVectors(this._panEnd,this._panStart).multiplyScalar(this.panSpeed),this._pan(this._panDelta.x,this._panDelta.y),this._panStart.copy(this._panEnd)}_handleTouchMoveDolly(e){let t=this._getSecondPointerPosition(e),n=e.pageX-t.x,i=e.pageY-t.y,r=Math.sqrt(n*n+i*i);this._dollyEnd.set(0,r),this._dollyDelta.set(0,Math.pow(this._dollyEnd.y/this._dollyStart.y,this.zoomSpeed)),this._dollyOut(this._dollyDelta.y),this._dollyStart.copy(this._dollyEnd);let o=(e.pageX+t.x)*.5,a=(e.pageY+t.y)*.5;this._updateZoomParameters(o,a)}_handleTouchMoveDollyPan(e){this.enableZoom&&this._handleTouchMoveDolly(e),this.enablePan&&this._handleTouchMovePan(e)}_handleTouchMoveDollyRotate(e){this.enableZoom&&this._handleTouchMoveDolly(e),this.enableRotate&&this._handleTouchMoveRotate(e)}_addPointer(e){this._pointers.push(e.pointerId)}_removePointer(e){delete this._pointerPositions[e.pointerId];for(let t=0;t<this._pointers.length;t++)if(this._pointers[t]==e.pointerId){this._pointers.splice(t,1);return}}_isTrackingPointer(e){for(let t=0;t<this._pointers.length;t++)if(this._pointers[t]==e.pointerId)return!0;return!1}_trackPointer(e){let t=this._pointerPositions[e.pointerId];t===void 0&&(t=new ye,this._pointerPositions[e.pointerId]=t),t.set(e.pageX,e.pageY)}_getSecondPointerPosition(e){let t=e.pointerId===this._pointers[0]?this._pointers[1]:this._pointers[0];return this._pointerPositions[t]}_customWheelEvent(e){let t=e.deltaMode,n={clientX:e.clientX,clientY:e.clientY,deltaY:e.deltaY};switch(t){case 1:n.deltaY*=16;break;case 2:n.deltaY*=100;break}return e.ctrlKey&&!this._controlActive&&(n.deltaY*=10),n}};function iw(s){this.enabled!==!1&&(this._pointers.length===0&&(this.domElement.setPointerCapture(s.pointerId),this.domElement.ownerDocument.addEventListener("pointermove",this._onPointerMove),this.domElement.ownerDocument.addEventListener("pointerup",this._onPointerUp)),!this._isTrackingPointer(s)&&(this._addPointer(s),s.pointerType==="touch"?this._onTouchStart(s):this._onMouseDown(s),this._cursorStyle==="grab"&&(this.domElement.style.cursor="grabbing")))}function sw(s){this.enabled!==!1&&(s.pointerType==="touch"?this._onTouchMove(s):this._onMouseMove(s))}function rw(s){switch(this._removePointer(s),this._pointers.length){case 0:this.domElement.releasePointerCapture(s.pointerId),this.domElement.ownerDocument.removeEventListener("pointermove",this._onPointerMove),this.domElement.ownerDocument.removeEventListener("pointerup",this._onPointerUp),this.dispatchEvent(tg),this.state=tt.NONE,this._cursorStyle==="grab"&&(this.domElement.style.cursor="grab");break;case 1:let e=this._pointers[0],t=this._pointerPositions[e];this._onTouchStart({pointerId:e,pageX:t.x,pageY:t.y});break}}function ow(s){let e;switch(s.button){case 0:e=this.mouseButtons.LEFT;break;case 1:e=this.mouseButtons.MIDDLE;break;case 2:e=this.mouseButtons.RIGHT;break;default:e=-1}switch(e){case ji.DOLLY:if(this.enableZoom===!1)return;this._handleMouseDownDolly(s),this.state=tt.DOLLY;break;case ji.ROTATE:if(s.ctrlKey||s.metaKey||s.shiftKey){if(this.enablePan===!1)return;this._handleMouseDownPan(s),this.state=tt.PAN}else{if(this.enableRotate===!1)return;this._handleMouseDownRotate(s),this.state=tt.ROTATE}break;case ji.PAN:if(s.ctrlKey||s.metaKey||s.shiftKey){if(this.enableRotate===!1)return;this._handleMouseDownRotate(s),this.state=tt.ROTATE}else{if(this.enablePan===!1)return;this._handleMouseDownPan(s),this.state=tt.PAN}break;default:this.state=tt.NONE}this.state!==tt.NONE&&this.dispatchEvent(_d)}function aw(s){switch(this.state){case tt.ROTATE:if(this.enableRotate===!1)return;this._handleMouseMoveRotate(s);break;case tt.DOLLY:if(this.enableZoom===!1)return;this._handleMouseMoveDolly(s);break;case tt.PAN:if(this.enablePan===!1)return;this._handleMouseMovePan(s);break}}function lw(s){this.enabled===!1||this.enableZoom===!1||this.state!==tt.NONE||(s.preventDefault(),this.dispatchEvent(_d),this._handleMouseWheel(this._customWheelEvent(s)),this.dispatchEvent(tg))}function cw(s){this.enabled!==!1&&this._handleKeyDown(s)}function hw(s){switch(this._trackPointer(s),this._pointers.length){case 1:switch(this.touches.ONE){case Zi.ROTATE:if(this.enableRotate===!1){this.state=tt.NONE;break}this._handleTouchStartRotate(s),this.state=tt.TOUCH_ROTATE;break;case Zi.PAN:if(this.enablePan===!1){this.state=tt.NONE;break}this._handleTouchStartPan(s),this.state=tt.TOUCH_PAN;break;default:this.state=tt.NONE}break;case 2:switch(this.touches.TWO){case Zi.DOLLY_PAN:if(this.enableZoom===!1&&this.enablePan===!1)return;this._handleTouchStartDollyPan(s),this.state=tt.TOUCH_DOLLY_PAN;break;case Zi.DOLLY_ROTATE:if(this.enableZoom===!1&&this.enableRotate===!1)return;this._handleTouchStartDollyRotate(s),this.state=tt.TOUCH_DOLLY_ROTATE;break;default:this.state=tt.NONE}break;default:this.state=tt.NONE}this.state!==tt.NONE&&this.dispatchEvent(_d)}function uw(s){switch(this._trackPointer(s),this.state){case tt.TOUCH_ROTATE:if(this.enableRotate===!1)return;this._handleTouchMoveRotate(s),this.update();break;case tt.TOUCH_PAN:if(this.enablePan===!1)return;this._handleTouchMovePan(s),this.update();break;case tt.TOUCH_DOLLY_PAN:if(this.enableZoom===!1&&this.enablePan===!1)return;this._handleTouchMoveDollyPan(s),this.update();break;case tt.TOUCH_DOLLY_ROTATE:if(this.enableZoom===!1&&this.enableRotate===!1)return;this._handleTouchMoveDollyRotate(s),this.update();break;default:this.state=tt.NONE}}function dw(s){this.enabled!==!1&&s.preventDefault()}function fw(s){s.key==="Control"&&(this._controlActive=!0,this.domElement.ownerDocument.addEventListener("keyup",this._interceptControlUp,{passive:!0,capture:!0}))}function pw(s){s.key==="Control"&&(this._controlActive=!1,this.domElement.ownerDocument.removeEventListener("keyup",this._interceptControlUp,{passive:!0,capture:!0}))}var Bo=[1,1,.7,.5,.35],mw=22,gw=12,ng=[30,480],ig=2,xw=2e3,sg=Math.min(window.devicePixelRatio,2),dc=class{constructor(e,t){this.renderer=e;this.software=t;this.step(t?Bo.length-1:0)}renderer;software;level=0;begun=0;exact=!1;onDrawn=()=>{};fence=null;fast=0;slowly=0;proof=ng[0];ratio=sg;moving=!1;counts=!1;get slow(){return this.level>0}get reduced(){return this.slow&&this.moving}get busy(){return this.fence!==null}begin(e){this.begun=performance.now(),this.moving=e,this.counts=e||!this.slow;let t=e?Bo[this.level]:1,n=this.exact?window.devicePixelRatio:sg*t;n!==this.ratio&&(this.ratio=n,this.renderer.setPixelRatio(n))}forget(){this.gl.deleteSync(this.fence),this.fence=null}except(){this.counts=!1}end(){let{gl:e}=this;this.fence=e.fenceSync(e.SYNC_GPU_COMMANDS_COMPLETE,0),e.flush(),window.setTimeout(()=>this.check(),ig)}text(){if(!this.slow)return"Graphics: full quality";let e=this.software?"no graphics processor":"slow",t=Math.round(100*Bo[this.level]);return`Graphics: ${e}. Moving pictures have ${t} % of the pixels along each axis (reduction ${this.level} of ${Bo.length-1}); still pictures have full quality.`}check(){let{gl:e,fence:t}=this;if(!t)return;let n=performance.now()-this.begun;if(e.getSyncParameter(t,e.SYNC_STATUS)!==e.SIGNALED&&n<xw){window.setTimeout(()=>this.check(),ig);return}e.deleteSync(t),this.fence=null,this.counts&&this.judge(n),this.onDrawn()}judge(e){this.fast=e<gw?this.fast+1:0,this.slowly=e>mw?this.slowly+1:0,this.slowly>1&&this.level<Bo.length-1?(this.proof=Math.min(2*this.proof,ng[1]),this.step(this.level+1)):this.fast>this.proof&&this.level>0&&this.step(this.level-1)}step(e){this.level=e,this.fast=this.slowly=0,document.documentElement.toggleAttribute("data-slow",e>0)}get gl(){return this.renderer.getContext()}};var fc=class extends yi{constructor(){super(),this.name="RoomEnvironment",this.position.y=-3.5;let e=new ln;e.deleteAttribute("uv");let t=new Mt({side:Kt}),n=new Mt,i=new ys(16777215,900,28,2);i.position.set(.418,16.199,.3),this.add(i);let r=new ue(e,t);r.position.set(-.757,13.219,.717),r.scale.set(31.713,28.305,28.591),this.add(r);let o=new _i(e,n,6),a=new it;a.position.set(-10.906,2.009,1.846),a.rotation.set(0,-.195,0),a.scale.set(2.328,7.905,4.651),a.updateMatrix(),o.setMatrixAt(0,a.matrix),a.position.set(-5.607,-.754,-.758),a.rotation.set(0,.994,0),a.scale.set(1.97,1.534,3.955),a.updateMatrix(),o.setMatrixAt(1,a.matrix),a.position.set(6.167,.857,7.803),a.rotation.set(0,.561,0),a.scale.set(3.927,6.285,3.687),a.updateMatrix(),o.setMatrixAt(2,a.matrix),a.position.set(-2.017,.018,6.124),a.rotation.set(0,.333,0),a.scale.set(2.002,4.566,2.064),a.updateMatrix(),o.setMatrixAt(3,a.matrix),a.position.set(2.291,-.756,-2.621),a.rotation.set(0,-.286,0),a.scale.set(1.546,1.552,1.496),a.updateMatrix(),o.setMatrixAt(4,a.matrix),a.position.set(-2.193,-.369,-5.547),a.rotation.set(0,.516,0),a.scale.set(3.875,3.487,2.986),a.updateMatrix(),o.setMatrixAt(5,a.matrix),this.add(o);let l=new ue(e,Nr(50));l.position.set(-16.116,14.37,8.208),l.scale.set(.1,2.428,2.739),this.add(l);let c=new ue(e,Nr(50));c.position.set(-16.109,18.021,-8.207),c.scale.set(.1,2.425,2.751),this.add(c);let h=new ue(e,Nr(17));h.position.set(14.904,12.198,-1.832),h.scale.set(.15,4.265,6.331),this.add(h);let u=new ue(e,Nr(43));u.position.set(-.462,8.89,14.52),u.scale.set(4.38,5.441,.088),this.add(u);let d=new ue(e,Nr(20));d.position.set(3.235,11.486,-12.541),d.scale.set(2.5,2,.1),this.add(d);let f=new ue(e,Nr(100));f.position.set(0,20,0),f.scale.set(1,.1,1),this.add(f)}dispose(){let e=new Set;this.traverse(t=>{t.isMesh&&(e.add(t.geometry),e.add(t.material))});for(let t of e)t.dispose()}};function Nr(s){return new ho({color:0,emissive:16777215,emissiveIntensity:s})}var rg=.26,yw=.06,vw=.5,pc=class{constructor(e,t,n){this.renderer=e;this.scene=t;this.lamp=n;this.intensity=n.intensity,t.environmentIntensity=rg}renderer;scene;lamp;texture=null;intensity;on=!1;show(e){e!==this.on&&(this.on=e,e&&(this.texture??=bw(this.renderer)),this.scene.environment=e?this.texture:null,this.lamp.intensity=e?vw*this.intensity:this.intensity,_w(this.scene,e))}inside(e){this.scene.environmentIntensity=yw,e(),this.scene.environmentIntensity=rg}};function _w(s,e){s.traverse(t=>{let{material:n}=t;for(let i of[n??[]].flat()){if(!(i instanceof Mt))continue;let[r,o]=[i.userData.metalness,i.userData.dullness];r!==void 0&&o!==void 0&&(i.metalness=e?r:o)}})}function bw(s){let e=new fc,t=new Tr(s),{texture:n}=t.fromScene(e,.04);return t.dispose(),e.dispose(),n}var ag={light:{sky:15331061,disc:16054266,strong:12174545,faint:14147303,shadow:.2},dark:{sky:1448995,disc:2041905,strong:4609124,faint:3160903,shadow:.5}},Or=30,og=3,gc=new S(.62,.36,.8).normalize(),mc=class{renderer;scene=new yi;camera=new dt(40,1,.01,60);orbit;placement=new Pe;robotWorld=new Pe;floor=new Pe;pace;moved=-1/0;look="normal";sky=new ve;dirty=!0;size=1;covered={left:0,right:0,bottom:0,top:0};framed=null;sun=new Ki(16777215,2.1);fill=new Ki(14674431,.7);hemisphere=new go(16777215,13223100,1.15);ambient=new vs(16777215,.15);shadow=new ue(new Xi(6,48),new co({opacity:.2}));grid=ww();disc=new ue(new Xi(4,64),new lt({toneMapped:!1}));darkness=window.matchMedia("(prefers-color-scheme: dark)");reflections;seeThrough=!1;constructor(e){let t=Mw();this.renderer=new Ar({canvas:e,antialias:t,alpha:!0,powerPreference:"high-performance"}),this.pace=new dc(this.renderer,!t),this.renderer.setPixelRatio(Math.min(window.devicePixelRatio,2)),this.renderer.outputColorSpace=ot,this.renderer.toneMapping=bo,this.renderer.toneMappingExposure=1,this.renderer.xr.enabled=!0,this.renderer.shadowMap.enabled=!0,this.renderer.shadowMap.type=bs,this.renderer.shadowMap.autoUpdate=!1;for(let n of[this.sun,this.fill,this.hemisphere,this.ambient])n.layers.set(og);this.camera.layers.enable(og),this.robotWorld.rotation.x=-Math.PI/2,this.placement.add(this.robotWorld),this.scene.add(this.placement,this.floor,this.sun,this.sun.target,this.fill,this.hemisphere,this.ambient),this.sun.castShadow=!0,this.sun.shadow.mapSize.set(1024,1024),this.sun.shadow.bias=-4e-4,this.sun.shadow.normalBias=.004,this.sun.shadow.radius=4,this.shadow.rotation.x=-Math.PI/2,this.shadow.receiveShadow=!0,this.shadow.position.y=5e-4,this.disc.rotation.x=-Math.PI/2,this.disc.position.y=-.002,this.floor.add(this.disc,this.grid,this.shadow),this.orbit=new uc(this.camera,e),this.orbit.enableDamping=!1,this.orbit.addEventListener("change",()=>{this.moved=performance.now(),this.dirty=!0}),this.reflections=new pc(this.renderer,this.scene,this.hemisphere),this.setLook("normal",!1),this.darkness.addEventListener("change",()=>this.setLook(this.look,this.seeThrough)),window.addEventListener("resize",()=>this.resize()),this.resize()}resize(){if(this.renderer.xr.isPresenting)return;let e=this.renderer.domElement,[t,n]=[e.clientWidth||1,e.clientHeight||1],i=this.renderer.getSize(new ye);(i.x!==t||i.y!==n)&&(this.renderer.setSize(t,n,!1),this.pace.forget());let{left:r,right:o,bottom:a,top:l}=this.covered;this.camera.setViewOffset(t,n,(o-r)/2,(a-l)/2,t,n),this.dirty=!0}cover(e,t,n,i){let{covered:r}=this;return e===r.left&&t===r.right&&n===r.bottom&&i===r.top?!1:(this.covered={left:e,right:t,bottom:n,top:i},this.resize(),!0)}get ground(){return[this.disc,this.grid,this.shadow]}get beside(){return this.covered.left}free(){let{clientWidth:e,clientHeight:t}=this.renderer.domElement;return[e-this.covered.right,t-this.covered.bottom]}frameAll(e,t){let{clientWidth:n,clientHeight:i}=this.renderer.domElement,{left:r,right:o,bottom:a,top:l}=this.covered,c=Math.max(.2,Math.min((i-a-l)/i,(n-r-o)/i)),h=.9*t/Math.sin(Math.atan(Math.tan(this.camera.fov*Math.PI/360)*c));this.camera.position.copy(e).addScaledVector(gc,h),this.camera.near=Math.max(.002,h/200),this.camera.far=60*Math.max(1,h),this.camera.updateProjectionMatrix(),this.orbit.target.copy(e),this.orbit.minDistance=.05*t,this.orbit.maxDistance=12*t,this.orbit.update(),this.framed={middle:e.clone(),radius:t,from:this.camera.position.clone()},this.dirty=!0}frameAgain(){let{framed:e,camera:t,renderer:n}=this;e&&!n.xr.isPresenting&&t.position.equals(e.from)&&this.frameAll(e.middle,e.radius)}relight(){let e=this.size*this.placement.scale.x,t=this.placement.position;this.sun.position.set(t.x+.9*e,t.y+2.6*e,t.z+1.3*e),this.sun.target.position.set(t.x,t.y+.35*e,t.z),this.fill.position.set(t.x-2*e,t.y+e,t.z-1.5*e);let n=this.sun.shadow.camera;n.left=n.bottom=-1.3*e,n.right=n.top=1.3*e,n.near=.2*e,n.far=6*e,n.updateProjectionMatrix(),this.sun.shadow.normalBias=.006*e,this.shadow.position.set(t.x,t.y+5e-4,t.z),this.shadow.scale.setScalar(Math.max(.2,.5*e));let i=.1*10**Math.round(Math.log10(Math.max(e,.001)));this.grid.scale.setScalar(i/.1),this.disc.scale.setScalar(i/.1),this.touch()}touch(){this.dirty=!0,this.renderer.shadowMap.needsUpdate=!0}get theme(){return this.darkness.matches?"dark":"light"}reflect(e){this.reflections.show(e),this.touch()}setLook(e,t){this.look=e,this.seeThrough=t;let n=e==="additive",i=ag[this.theme];this.sky.set(n?0:i.sky),this.disc.material.color.set(i.disc),this.shadow.material.opacity=i.shadow,Sw(this.grid.geometry,this.theme),this.scene.background=t?null:this.sky,this.ambient.intensity=n?.5:.15,this.sun.castShadow=!n,this.shadow.visible=!n,this.disc.visible=!t&&!n,this.grid.visible=!t;let r=this.grid.material;r.opacity=n?.35:1,r.transparent=n,r.needsUpdate=!0,this.touch()}};function Mw(){let s=document.createElement("canvas").getContext("webgl2"),e=s?.getExtension("WEBGL_debug_renderer_info"),t=s&&e?String(s.getParameter(e.UNMASKED_RENDERER_WEBGL)):"";return s?.getExtension("WEBGL_lose_context")?.loseContext(),!/swiftshader|llvmpipe|softpipe|basic render/i.test(t)}function ww(){let s=[],e=(i,r)=>s.push(.1*i,0,.1*r);for(let i=-Or;i<=Or;i++)for(let r=-Or;r<Or;r++)Math.hypot(i,r+.5)>Or||(e(i,r),e(i,r+1),e(r,i),e(r+1,i));let t=new Ye;t.setAttribute("position",new Ue(s,3)),t.setAttribute("color",new Ue(s.length,3));let n=new Ot({vertexColors:!0,toneMapped:!1});return new vn(t,n)}function Sw(s,e){let t=ag[e],[n,i,r]=[new ve(t.strong),new ve(t.faint),new ve(t.sky)],o=s.getAttribute("position"),a=s.getAttribute("color"),l=new ve;for(let c=0;c<o.count;c++){let[h,u]=[Math.round(10*o.getX(c)),Math.round(10*o.getZ(c))],d=c%2?c-1:c+1,f=Math.round(10*o.getX(d))===h?h:u,g=Math.min(1,Math.hypot(h,u)/Or)**1.5;l.copy(f%5===0?n:i).lerp(r,g),a.setXYZ(c,l.r,l.g,l.b)}a.needsUpdate=!0}function Ds(s){s.removeFromParent(),s.traverse(e=>{let t=e;t.geometry?.dispose();for(let n of[t.material??[]].flat())n.dispose()})}var lg=[1,10,100,1e3,1e4,1e5],Tw=.002,Aw=.03,xc=class{constructor(e,t){this.world=e;this.rcmBall=new ue(new Hn(1,20,12),At(Uo)),this.shaft=new ue(new tn(1,1,1,8),At(Uo)),this.rcmBall.visible=this.shaft.visible=!1,this.group.add(this.rcmBall,this.shaft,this.rcmLabel.sprite,this.ghostLabel.sprite,this.scenery),t.add(this.group)}world;group=new Pe;shows={path:!0,rcm:!0,workspace:!1,ghost:!0,scenery:!1,labels:!0};ghostText="";cloudCount=0;cloudDone=!1;points=[];path=null;rcmBall;shaft;rcmLabel=new sn;further=[];ghostLabel=new sn;ghost=null;scenery=new Pe;around=null;lying="";cloud=null;cloudParts=[];size=1;line=.024;setPath(e){this.points=e,this.path&&Ds(this.path),this.path=e.length>=6?bd(e,.0016*this.size):null,this.path&&this.group.add(this.path),this.world.touch()}setSize(e,t=.024*e){this.size=e,this.line=t,this.setPath(this.points),this.cloudCount&&this.drawCloud()}setScenery(e){this.around=e}sceneryText(e){let t=e.protocol();return!this.shows.scenery||!this.around||!t?"":this.around.patients[t]?.assumed??this.around.no_patient[t]??""}standScenery(e,t){let n=e.protocol(),i=this.shows.scenery?this.around?.patients[n]:void 0;if(t.hide(i?.replaces??[]),this.scenery.visible=i!==void 0,!(!i||this.lying===n)){this.lying=n;for(let r of[...this.scenery.children])Ds(r);new Dr().loadAsync(`${e.info?.files??""}patient/${n}.glb`).then(r=>{this.lying===n&&(this.scenery.add(...ns(r.scene)),this.world.touch())},()=>{this.lying="",e.say(`The patient of ${n} could not be loaded.`)})}}addCloud(e,t,n){let i=cg(e);i.length&&this.cloudParts.push({points:i,values:t?cg(t):null}),this.cloudCount+=i.length/3,this.cloudDone=n,this.drawCloud()}clearCloud(){this.cloudParts=[],this.cloudCount=0,this.cloudDone=!1,this.cloud&&Ds(this.cloud),this.cloud=null,this.world.touch()}update(e,t){let n=this.shows;this.path&&(this.path.visible=n.path,this.path.material.color.setHex(Ir)),this.standScenery(e,t),this.cloud&&(this.cloud.visible=n.workspace);let i=yc(e,t);this.drawRcm(e,i),this.drawGhost(e,t,i)}drawRcm(e,t){let n=e.state.rcm,i=this.shows.rcm&&n!==null&&t!==null;this.rcmBall.visible=i,this.shaft.visible=i&&(e.state.rcm_error_m??0)<Tw,this.rcmLabel.sprite.visible=i&&this.shows.labels;let r=e.state.trocars;if(this.drawFurther(i?r.slice(1):[]),!i)return;let o=this.size,a=new S().fromArray(n),l=new S().setFromMatrixPosition(t),c=a.clone().sub(l);c.length()<.001*o&&c.setFromMatrixColumn(t,2),c.normalize();let h=a.clone().addScaledVector(c,.12*o);this.rcmBall.position.copy(a),this.rcmBall.scale.setScalar(.009*o),hg(this.shaft,l,h,.0018*o);let u=r.length>1,d=e.info?.ports.find(g=>!u||g.trocar===r[0].name),f=e===e.page.robot;this.rcmLabel.sprite.renderOrder=f?10:9,this.sayOf(this.rcmLabel,a,d?`${e.info?.name}, port ${d.name}`:u?r[0].name:"RCM",f?u?r[0].error_m:e.state.rcm_error_m:null,f?u?r[0].depth_m:e.state.depth_m:null)}drawFurther(e){for(;this.further.length<e.length;){let t=new ue(this.rcmBall.geometry,this.rcmBall.material),n=new sn;this.group.add(t,n.sprite),this.further.push({ball:t,label:n})}this.further.forEach(({ball:t,label:n},i)=>{let r=i<e.length;t.visible=r,n.sprite.visible=r&&this.shows.labels,r&&(t.position.fromArray(e[i].at),t.scale.setScalar(.009*this.size),this.sayOf(n,t.position,e[i].name,e[i].error_m,e[i].depth_m))})}sayOf(e,t,n,i,r){let o=this.size,a=[n];i!==null&&a.push(`shaft off by ${Wt(i)}`),r!==null&&a.push(`depth ${Wt(r)}`),e.sprite.position.copy(t).addScaledVector(new S(0,0,1),.012*o),e.say(a.join(`
`),"#9a4f00",this.world.look,this.line)}drawGhost(e,t,n){let i=e.info,r=e.frame?.ghost;if(!(this.shows.ghost&&i!==null&&n!==null&&!!r)){this.ghost&&(this.ghost.visible=!1),this.ghostLabel.sprite.visible=!1,this.ghostText=e.state.variant?"These equations give no tool pose at this state.":"";return}this.ghost||(this.ghost=t.copyOf(i.tool.link,Om,.45),this.ghost.renderOrder=2,this.group.add(this.ghost));let a=Mn(r),l=new S,c=new De;n.decompose(l,c,new S);let h=a.p.clone().sub(l),u=a.q.clone().multiply(c.clone().invert());u.w<0&&u.set(-u.x,-u.y,-u.z,-u.w);let d=Math.hypot(u.x,u.y,u.z),f=2*Math.atan2(d,u.w),g=Ew(Math.max(h.length()/this.size,f/6)),y=l.clone().addScaledVector(h,g),p=d>1e-9?new S(u.x,u.y,u.z).divideScalar(d):h.set(0,0,1),m=new De().setFromAxisAngle(p,Math.min(f*g,1)).multiply(c),b=new _e().compose(y,m,new S(1,1,1));b.multiply(yd(i.tool.T_link_tool).invert()),b.decompose(this.ghost.position,this.ghost.quaternion,this.ghost.scale);let E=a.p.distanceTo(l),M=(180/Math.PI*f).toFixed(f>.001?3:5);this.ghost.visible=E>2e-8||f>2e-7;let R=g>1?`, magnified \xD7${g.toLocaleString("en")}`:", to scale";this.ghostText=this.ghost.visible?`Equations \u2194 mechanism: ${Wt(E)}, ${M}\xB0${R}`:"Equations and mechanism agree within the resolution of the stream (float32).",this.ghostLabel.sprite.visible=this.ghost.visible&&this.shows.labels,this.ghostLabel.sprite.position.copy(y).addScaledVector(new S(0,0,1),.09*this.size),this.ghostLabel.say(`equations: ${Wt(E)} from the tool
${g>1?`magnified \xD7${g.toLocaleString("en")}`:"to scale"}`,"#6a25ad",this.world.look,this.line)}drawCloud(){this.cloud&&Ds(this.cloud);let e=this.cloudCount,t=new Float32Array(3*e),n=new Float32Array(3*e),i=0,r=new ve;for(let l of this.cloudParts){t.set(l.points,3*i);for(let c=0;c<l.points.length/3;c++){let h=l.values?.[c]??1;r.setHSL(.6*(1-Math.min(1,Math.log10(Math.max(1,h))/2.5)),.75,.5),r.toArray(n,3*(i+c))}i+=l.points.length/3}let o=new Ye;o.setAttribute("position",new Ue(t,3)),o.setAttribute("color",new Ue(n,3));let a=new Wi({vertexColors:!0,size:.018*this.size,transparent:!0,opacity:.75,depthWrite:!1});this.cloud=new ms(o,a),this.cloud.visible=this.shows.workspace,this.group.add(this.cloud),this.world.touch()}};function yc(s,e){let t=s.info,n=t?e.links.get(t.tool.link)?.node:void 0;return!t||!n?null:new _e().compose(n.position,n.quaternion,new S(1,1,1)).multiply(yd(t.tool.T_link_tool))}function Ew(s){return lg.find(e=>s*e>=Aw/3)??lg.at(-1)}function hg(s,e,t,n){let i=t.clone().sub(e),r=Math.max(i.length(),1e-9);s.position.copy(e).addScaledVector(i,.5),s.quaternion.setFromUnitVectors(new S(0,1,0),i.divideScalar(r)),s.scale.set(n,r,n)}function bd(s,e){let t=s.length/3-1,n=new _i(new tn(1,1,1,6,1,!0),At(Ir),t),i=new it,[r,o]=[new S,new S];for(let a=0;a<t;a++)hg(i,r.fromArray(s,3*a),o.fromArray(s,3*a+3),e),i.updateMatrix(),n.setMatrixAt(a,i.matrix);return n.frustumCulled=!1,n}function ns(s){let t=[...(s.children.length===1&&s.children[0]?s.children[0]:s).children].filter(n=>!n.name.startsWith("frame_"));for(let n of t){let i=n.userData.link;typeof i=="string"&&(n.name=i),n.traverse(r=>{if(!(r instanceof ue))return;let o=r.material;o.transparent&&(o.side=It,o.depthWrite=!1),r.receiveShadow=r.castShadow=!o.transparent})}return t}function cg(s){return new Float32Array(Oo(s).buffer)}var Rw=250,ug=.5,Cw=8095636,dg="#d81b2a",Pw=.6,_c=class{constructor(e,t,n){this.app=t;this.console=n;this.group.add(this.place),t.world.robotWorld.add(this.group),this.plot=new Md(e)}app;console;group=new Pe;place=new Pe;material=new Mt({color:jt,opacity:ug,transparent:!0,depthWrite:!1,polygonOffset:!0,polygonOffsetFactor:2,polygonOffsetUnits:2});links=[];path=null;tree=null;robot="";target=new Float32Array;motion=null;clearance=null;plot;pressed=new Map;get state(){return this.app.model.console?.plan??null}get phase(){return this.state?.phase??"off"}get holds(){return this.phase==="plan"||this.phase==="preview"||this.phase==="run"}press(e,t){let n=this.pressed.get(e);if(t!==(n!==void 0)){if(t){let i=this.phase==="aim";this.pressed.set(e,i?-1/0:performance.now()),i||this.ask("aim");return}this.pressed.delete(e),this.phase==="aim"&&performance.now()-n>Rw&&this.ask("find")}}forget(e){this.pressed.delete(e)}aim(){this.ask("aim")}accept(){this.phase==="preview"&&this.ask("accept")}cancel(){this.phase!=="off"&&this.ask("cancel")}ask(e){e==="aim"&&this.console.lift(),e!=="cancel"&&this.console.pens.use(),this.app.ask("plan",{do:e,hand:this.state?.hand||this.console.chosen})}controls(){let e=(t,n,i,r,o)=>({kind:"button",id:t,label:n,press:i,off:r,hint:o});return{kind:"row",shown:()=>this.phase!=="off",items:[e("plan-find",()=>this.phase==="preview"?"Change the target":"Plan a motion",()=>this.phase==="preview"?this.aim():this.ask("find"),()=>this.phase!=="aim"&&this.phase!=="preview","Plan a motion of the arm to the target (release P)"),e("plan-accept",()=>"Accept",()=>this.accept(),()=>this.phase!=="preview","Let the arm make the planned motion (Enter)"),e("plan-cancel",()=>this.phase==="run"?"Stop":"Cancel",()=>this.cancel(),()=>!1,"End planning; the arm stays where it is (Escape)")]}}status(){let{state:e}=this;if(!e)return null;let{said:t,blocked:n}=e,i=this.console.called(e.robot);if(t)return{tone:e.bad?"bad":e.phase==="off"?"good":"warn",text:t};if(e.phase==="off")return null;if(e.phase==="aim"){if(n)return{tone:"warn",text:`Target of ${i} (red): ${n}.`};let r=e.ready?"":" The geometry is being loaded.";return{tone:"good",text:`Move the target of ${i}; the target may pass through anything, and the arm is at rest. Then plan a motion.${r}`}}return e.phase==="plan"?{tone:"good",text:`Planning a motion of ${i}: ${fg(e.done)}`}:e.phase==="run"?{tone:"good",text:`${i.replace(/^the/,"The")} follows the plan: ${fg(e.done)}`}:{tone:"good",text:`Motion of ${i}, ${this.motion?.duration.toFixed(1)??"\u2013"} s. ${this.clear()}Accept it, or cancel.`}}clear(){let{clearance:e}=this;if(!e||e.proven===null)return"The clearance is being computed. ";let[t,n]=e.bodies,i=t&&n?` (${t}, ${n})`:"";return`Minimum clearance ${zo(e.found??0)}${i}, proven to be at least ${zo(e.proven)}. `}hear(e){if(e.type==="target")this.robot=e.robot,this.target=vc(e.poses);else if(e.type==="plan")this.take(e);else if(e.type==="clearance")this.clearance=e,this.plot.show(e,this.motion?.duration??0);else if(e.type==="state")this.holds&&this.console.pens.active&&this.console.pens.use();else return;this.app.refresh()}take(e){for(let r of[this.path,this.tree])r&&Ds(r);this.path=this.tree=this.motion=this.clearance=null;let t=this.member(e.robot);if(!e.poses||!t)return;this.robot=e.robot,this.motion={poses:vc(e.poses),every:e.every,duration:e.duration,begun:performance.now()};let n=6e-4*t.size;this.path=bd([...vc(e.tip)],n);let i=vc(e.tree);if(i.length){let r=new Ye;r.setAttribute("position",new Ue(i,3)),this.tree=new vn(r,new Ot({color:Cw,transparent:!0,opacity:.55,toneMapped:!1})),this.tree.frustumCulled=!1}this.place.add(...[this.path,this.tree].filter(r=>r!==null))}member(e){return this.app.members.find(t=>t.model.info?.name===e)}update(e){let{phase:t,app:n}=this,i=this.group.visible;if(this.group.visible=t!=="off"&&this.stand(),this.group.visible!==i&&n.world.touch(),this.plot.place(this.console,t==="preview"&&this.clearance!==null&&!n.xr.presenting),!this.group.visible)return;let r=t==="aim"&&this.state?.blocked?Ps:jt;this.material.color.getHex()!==r&&(this.material.color.setHex(r),n.world.dirty=!0);for(let o of[this.path,this.tree])o&&(o.visible=t==="preview"||t==="run"&&o===this.path);this.pose(this.shown(e))}shown(e){let{motion:t}=this,n=7*this.links.length;if(!t||this.phase==="aim"||this.phase==="plan")return this.target;let i=t.poses.length/n,r=t.poses.subarray((i-1)*n);if(this.phase==="run")return r;let o=(e-t.begun)/1e3%(t.duration+Pw),a=Math.min(i-1,Math.floor(o/t.every));return this.plot.mark(Math.min(o,t.duration)),t.poses.subarray(a*n,(a+1)*n)}pose(e){let t=!1;this.links.forEach((n,i)=>{if(e.length<7*(i+1))return;let{p:r,q:o}=Mn(e.subarray(7*i,7*i+7));t||=!n.position.equals(r)||!n.quaternion.equals(o),n.position.copy(r),n.quaternion.copy(o)}),t&&(this.app.world.moved=performance.now(),this.app.world.dirty=!0)}stand(){let e=this.member(this.robot),{robot:t,model:n}=e??{};if(!e||!t||!n?.info||!this.target.length)return!1;if(this.place.userData.robot===this.robot)return!0;for(let i of this.links)i.removeFromParent();return this.links=n.info.links.map(i=>{let r=t.copyOf(i,jt,ug);for(let o of r.children)o.material.dispose(),o.material=this.material;return r.renderOrder=3,r}),this.place.add(...this.links),this.place.userData.robot=this.robot,this.place.position.copy(e.place.position),this.place.quaternion.copy(e.place.quaternion),!0}},Md=class{canvas=document.createElement("canvas");message=null;duration=0;at=0;shown="";constructor(e){this.canvas.className="clearance",this.canvas.dataset.id="clearance",this.canvas.setAttribute("role","img"),this.canvas.setAttribute("aria-label","Clearance over the planned motion"),this.canvas.hidden=!0,e.append(this.canvas)}show(e,t){[this.message,this.duration,this.shown]=[e,t,""]}mark(e){this.at=e}place(e,t){let{corner:n}=e.views,[i]=e.views.free,r=Math.min(n.height,130),o=n.left+n.width+10,a=n.top+n.height-r,l=document.querySelector(".score.across:not([hidden])")?.getBoundingClientRect();l&&l.right>o&&l.left<i&&l.bottom>a&&(o=n.left,a=Math.round(Math.min(l.top,n.top))-r-10);let c=Math.min(280,i-o-12);if(this.canvas.hidden=!t||!this.message?.distance.length||c<110||e.tools!==null,this.canvas.hidden)return;let h=`${o} ${a} ${r} ${c} ${this.message?.distance.length} ${this.at.toFixed(2)} ${this.message?.proven}`;h!==this.shown&&(this.shown=h,Object.assign(this.canvas.style,{left:`${o}px`,top:`${a}px`,width:`${c}px`,height:`${r}px`}),this.draw(c,r))}draw(e,t){let{canvas:n,message:i}=this;if(!i)return;[n.width,n.height]=[2*e,2*t];let r=n.getContext("2d");r.setTransform(2,0,0,2,0,0),r.font="11px system-ui, sans-serif";let o=Math.max(.001,1.1*Math.max(...i.distance,i.proven??0)),[a,l]=[28,t-16],c=y=>8+y/Math.max(this.duration,.001)*(e-16),h=y=>l-y/o*(l-a),u=Math.min(...i.distance,i.found??1/0);r.fillStyle="#17212e";let d=`${e<260?"Minimum":"Clearance: minimum"} ${zo(u)}`;r.fillText(d,8,13,e-16),i.proven!==null&&(r.fillStyle=dg,r.fillText(`proven ${zo(i.proven)}`,16+r.measureText(d).width,13,e-24-r.measureText(d).width)),r.fillStyle="#55616f",r.fillText(zo(o),8,25),r.fillText("0 s",8,t-4);let f=`${this.duration.toFixed(1)} s`;r.fillText(f,e-8-r.measureText(f).width,t-4);let g=(y,p,m=[])=>{r.setLineDash(m),r.strokeStyle=y,r.beginPath();for(let[b,E]of p)r.lineTo(c(b),h(E));r.stroke()};g("#9aa5b2",[[0,0],[this.duration,0]]),i.proven!==null&&g(dg,[[0,i.proven],[this.duration,i.proven]],[4,3]),r.lineWidth=1.6,g("#2268c9",i.t.map((y,p)=>[y,i.distance[p]??0])),r.lineWidth=1,g("#17212e",[[this.at,0],[this.at,o]])}},fg=s=>`${Math.round(100*s)} %`,zo=s=>`${(1e3*s).toFixed(1)} mm`;function vc(s){return new Float32Array(Oo(s).buffer)}var wt=(s,e="",t="")=>{let n=document.createElement(s);return e&&(n.className=e),t&&(n.textContent=t),n},bc=class{constructor(e,t){this.app=t;this.board.dataset.id="score",this.board.setAttribute("aria-label","Scoreboard"),this.card.dataset.id="result",this.card.setAttribute("role","status"),this.board.hidden=this.card.hidden=!0,e.append(this.board,this.card)}app;board=wt("section","score");card=wt("section","card");shown="";around="";refresh(){let e=this.app.model.console?.task??null,t=JSON.stringify(e);this.board.classList.toggle("guided",!!e?.stages);let n=this.place();if(t===this.shown){n&&this.fit();return}this.shown=t,this.board.hidden=!e||e.over!==null,this.card.hidden=!e?.over,e&&(this.app.objects.number(e.rings.map(([i])=>i)),this.board.replaceChildren(wt("h2","",e.title),...Lw(e),...Dw(e)),this.fit(),e.over&&this.card.replaceChildren(wt("h2","",e.over),mg(e),wd(e),this.report(e),this.again()))}place(){let e=this.app.console?.views,t=this.board.classList.contains("guided"),n=e&&!t?Iw(e):this.column(e),i=JSON.stringify(n);if(i===this.around)return!1;this.around=i,this.board.classList.toggle("across",e!==void 0&&!t);let r=window.matchMedia("(max-width: 760px)").matches;this.board.classList.toggle("top",e!==void 0&&t&&(r||e.low<e.corner.top));for(let o of["top","bottom","left","width","min-width","max-height"]){let a=n[o];a===void 0?this.board.style.removeProperty(o):this.board.style.setProperty(o,typeof a=="number"?`${a}px`:a)}return!0}covers(){return this.board.matches(".guided:not(.top):not([hidden])")?Math.round(this.board.getBoundingClientRect().right):0}column(e){let t=document.querySelector("header")?.getBoundingClientRect().bottom??0,n=Math.round(t)+10,i=Math.max(0,(e?.low??window.innerHeight)-n-10);return{top:n,"max-height":i,"min-width":e?.corner.width??0}}fit(){let e=a=>[...this.board.querySelectorAll(a)],t=e(".events li").reverse(),n=e('.stages [data-state="done"]'),i=this.app.console?.views;i&&(i.high=this.board.matches(".top:not([hidden])")?this.board.getBoundingClientRect().bottom:0);let o=[...this.board.matches(".guided")?[]:e(".next"),...t.slice(0,-1),...e("tr").reverse(),...t.slice(-1),...n,...e("h2")];for(let a of o)a.hidden=!1;for(let a of o){if(this.board.scrollHeight<=this.board.clientHeight)break;a.hidden=!0}}report(e){let{report:t}=e;if(!t||t.attempt!==e.attempt)return wt("p","","This attempt has no report.");if(t.problem)return wt("p","wrong",`There is no report: ${t.problem}`);if(!t.ready)return wt("p","","The report is being made: the session is replayed and measured \u2026");let n=wt("a","","Open the report");return n.href=`report-${t.attempt}.html`,n.target="_blank",n.dataset.id="report",n}again(){let e=wt("button","enter","Restart");return e.dataset.id="again",e.onclick=()=>this.app.ask("task",{do:"restart"}),e}};function Iw(s){let{corner:e}=s,[t]=s.free,n=e.left+e.width+12,i=e.top+e.height-(s.flat?0:26),r=Math.min(t-n-12,s.flat?700:540);if(r>=380)return{left:n,width:r,top:"auto",bottom:window.innerHeight-i,"max-height":i-e.top+60};let o=window.innerHeight-e.top+10;return{left:e.left,width:t-2*e.left,top:"auto",bottom:o,"max-height":e.top/2}}function wd(s){let e=wt("table");for(let[t,n]of s.rows){let i=wt("tr");i.append(wt("td","",t),wt("td","value",n)),e.append(i)}return e}function Lw(s){if(!s.next||s.over)return[];let e=wt("p","next",s.next);return e.dataset.id="next",[e]}function Dw(s){return s.stages?[pg(s),mg(s),wd(s)]:[wd(s),Uw(s),pg(s)]}var Nw={done:"\u2713",open:"\u25CB",failed:"\u2717"};function mg(s){let e=wt("ul","stages");for(let[t,n,i]of s.stages??[]){let r=s.over&&n==="open"?"failed":n,o=wt("li","",`${Nw[r]} ${t}`);o.dataset.state=r,r==="failed"&&o.append(wt("small","",i)),e.append(o)}return e}var Ow=s=>s.replaceAll("_"," ").replace(/(?<=[a-z])(?=\d+$)/," ");function Uw(s){let e=wt("ul","rings");for(let[t,n,i]of s.rings){let r=wt("li","",`${Ow(t)}: ${n}`),o=wt("span","ring");o.style.borderColor=i,r.prepend(o),e.append(r)}return e}function pg(s){let e=wt("ol","events");for(let[t,n,i]of s.events.toReversed()){let r=wt("li","",`${t.toFixed(1)} s  ${i}`);r.dataset.tone=n,e.append(r)}return e}function Sd(s){return s.stages?.every(([,e])=>e==="done")?"good":"plain"}function gg(s){let e=()=>s.model.console?.task??null;return[{kind:"text",id:"task-line",text:()=>{let t=e();if(!t)return"";let n=t.next??t.events.at(-1)?.[2]??"";return`${t.rows.map(([i,r])=>`${i}: ${r}`).join(" \xB7 ")}
${t.over??n}`},tone:()=>{let t=e();return t?.over?Sd(t):t?.events.at(-1)?.[1]==="bad"?"bad":"plain"}},{kind:"row",items:[{kind:"button",id:"task-end",label:()=>"End the task",off:()=>e()?.over!==null,press:()=>s.ask("task",{do:"end"}),hint:"Stop here, and show the result"},{kind:"button",id:"task-restart",label:()=>"Restart",press:()=>s.ask("task",{do:"restart"}),hint:"Begin a new attempt, with instruments, objects and measures as at the start"}]}]}var xg=.0032,Fw=[new S(1,0,0),new S(0,1,0),new S(0,0,1)].flatMap(s=>[s,s.clone().negate()]),kw=14015458,Bw=16734751,Mc=class{constructor(e,t){this.app=e;this.console=t}app;console;shown={};refresh(){for(let e of Qe){let t=this.app.model.console?.hands[e],n=t?.carries??t?.tool,i=this.console.info.tools.find(c=>c.name===n),r=this.app.members.find(c=>c.model.info?.name===t?.robot);if(!t||!i||!r?.robot){this.remove(e);continue}let o=this.shown[e];if(o?.tool!==i.name||o.robot!==t.robot){if(this.remove(e),o=this.make(i,t.robot),!zw(o.group,r))continue;this.shown[e]=o,this.app.world.touch()}let a=t.open?Math.asin(Math.min(.9,i.open/2/i.jaw)):0;for(let[c,h]of o.jaws)c.rotation.x!==h*a&&this.app.world.touch(),c.rotation.x=h*a;let l=t.active?Bw:0;o.material.emissive.getHex()!==l&&(o.material.emissive=new ve(l),this.app.world.touch())}}drawn(e){let t=this.shown[e];return t?{tool:t.tool,angle:Math.abs(t.jaws[0]?.[0].rotation.x??0)}:null}remove(e){let t=this.shown[e];t&&(t.group.removeFromParent(),t.group.traverse(n=>{n instanceof ue&&n.geometry.dispose()}),t.material.dispose(),delete this.shown[e],this.app.world.touch())}make(e,t){let n=new Pe,i=new Mt({color:kw,metalness:.6,roughness:.35}),{jaw:r}=e,o=(h,u,d,f,g)=>{let y=new ue(h,i);y.position.set(d,f,g),u.add(y)},a=new tn(xg,xg,.006,20).rotateX(Math.PI/2);o(a,n,0,0,-r-.003);let l=[],c=h=>{let u=new Pe;return u.position.z=-r,n.add(u),l.push([u,-h]),u};for(let h of e.kind==="scalpel"||e.kind==="cautery"?[]:[1,-1]){let u=c(h),d=h*.0012;if(e.kind==="scissors"){o(new tn(0,.0024,r,3).rotateX(Math.PI/2).scale(.3,1,1),u,h*5e-4,d,r/2);continue}let f=e.kind==="clip_applier"?.0052:.0042;if(o(new ln(f,.0016,r),u,0,d,r/2),e.kind==="clip_applier"){o(new ln(f,.0034,.0016),u,0,h*.0019,r-8e-4);continue}for(let g=1;g<6;g++)o(new ln(f,7e-4,8e-4),u,0,h*3e-4,g*r/6)}return e.kind==="scalpel"&&o(new tn(0,.0045,r,3).rotateX(Math.PI/2).scale(.12,1,1),n,0,.0012,-r/2),e.kind==="cautery"&&(o(new tn(7e-4,7e-4,r,12).rotateX(Math.PI/2),n,0,0,-r/2),o(new ln(.002,.0062,.002),n,0,.0031,-.001)),{tool:e.name,robot:t,group:n,jaws:l,material:i}}};function zw(s,e){let t=e.model.info,n=t&&e.robot?.links.get(t.tool.link);if(!t||!n)return!1;let{p:i,q:r}=Mn(t.tool.T_link_tool),o=new S,a=1/0;for(let l of Fw){let c=l.clone().applyQuaternion(r),h=Math.max(...n.points.map(u=>u.clone().sub(i).dot(c)));h<a&&([a,o]=[h,c])}return s.position.copy(i),s.quaternion.copy(new De().setFromUnitVectors(new S(0,0,1),o)),n.node.add(s),!0}var Xn=["left","right"],Hw=`
        void main() {
          float l = dot(texture2D(left, at).rgb, weight);
          float r = dot(texture2D(right, at).rgb, weight);
          gl_FragColor = vec4(l, r, r, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`,Gw=`
        void main() {
          float row = height - 0.5 - gl_FragCoord.y;
          gl_FragColor = vec4((mod(row + odd, 2.0) < 0.5 ? texture2D(left, at) : texture2D(right, at)).rgb, 1.0);
          #include <tonemapping_fragment>
          #include <colorspace_fragment>
        }`,wc=class{constructor(e=[0,1]){this.stereo=e;for(let t of Xn)this[t].matrixAutoUpdate=this[t].matrixWorldAutoUpdate=!1;this.sheets={"red-cyan":yg(Hw),rows:yg(Gw)}}stereo;left=new dt;right=new dt;pictures={};sheets;flat=new Gn(-1,1,1,-1,0,1);follow(e){let[t,n]=this.stereo;for(let i of Xn){let r=this[i],o=(i==="left"?-t:t)/2;r.matrixWorld.makeTranslation(o,0,0).premultiply(e.matrixWorld),r.matrixWorldInverse.copy(r.matrixWorld).invert(),r.projectionMatrix.copy(e.projectionMatrix);let a=r.projectionMatrix.elements;a[8]-=a[0]*o/n,r.projectionMatrixInverse.copy(r.projectionMatrix).invert()}}picture(e,t,n){let i=this.pictures[e]??=new Tt(t,n,{samples:4,type:bn});return i.setSize(t,n),i}overlay(e,t,n=!1){let{uniforms:i}=this.sheets[t].material;for(let r of Xn)i[r].value=this.pictures[r]?.texture??null;i.height.value=e.domElement.height,i.odd.value=n?1:0,e.render(this.sheets[t],this.flat)}};function yg(s){let e=new dn({uniforms:{left:{value:null},right:{value:null},height:{value:0},odd:{value:0}},vertexShader:"varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",fragmentShader:`
        varying vec2 at;
        uniform sampler2D left;
        uniform sampler2D right;
        uniform float height;
        uniform float odd;
        const vec3 weight = vec3(0.2126, 0.7152, 0.0722);
        ${s}`,depthTest:!1,depthWrite:!1}),t=new ue(new Vt(2,2),e);return t.frustumCulled=!1,t}var Ho=1,Go=.62,Vw=1.15,Td=.3,Ww=.45,Xw=.42,qw=250,$w=5e3,Yw=50,vg=1280,Kw={left:1,right:2},Sc=class{constructor(e,t){this.app=e;this.views=t;let n=()=>new ue(new Vt(Ho,Go),new lt);this.panes={left:n(),right:n()};for(let r of Xn)this.panes[r].layers.set(Kw[r]);this.small=n(),this.small.scale.setScalar(Td),this.small.position.set(-Ho*(.5-Td/2)+.01,-Go*(.5-Td/2)+.01,.004),this.small.material.map=this.room.texture;let i=new ue(new Vt(Ho+.016,Go+.016),new lt({color:2765632}));i.position.z=-.003,this.group.add(i,this.panes.left,this.panes.right,this.small),this.group.visible=!1,e.world.scene.add(this.group)}app;views;group=new Pe;panes;small;room=new Tt(480,Math.round(480*Go/Ho),{samples:4});drawn=-1/0;height=0;last=0;turned(e){return this.group.getWorldQuaternion(e)}placeBefore(e,t){let n=t.clone().setY(0);n.lengthSq()<1e-6&&n.set(0,0,-1),this.group.position.copy(e).addScaledVector(n.normalize(),Vw),this.height=this.group.position.y-=.08,this.group.lookAt(e.x,this.group.position.y,e.z),this.group.visible=!0}hide(){this.group.visible=!1,this.app.world.placement.visible=!0}draw(e){let{world:t}=this.app,n=this.views.large==="scope",i=e-this.last>Yw?$w:qw;if(this.last=e,this.group.scale.setScalar(n?1:Ww),this.group.position.y=this.height+(n?0:Xw),this.small.visible=n,t.dirty){let r=Math.round(Math.min(vg,Math.max(256,.6*this.eyeWidth()))),o=Math.round(r*Go/Ho),a=this.views.drawEyes(r,o);for(let l of Xn){let{material:c}=this.panes[l];c.map!==a[l].texture&&(c.map=a[l].texture,c.needsUpdate=!0)}n&&e-this.drawn>i&&(this.drawn=e,this.views.drawRoom(this.room))}t.placement.visible===n&&(t.renderer.shadowMap.needsUpdate=!0),t.placement.visible=!n}eyeWidth(){return this.app.world.renderer.xr.getCamera().cameras[0]?.viewport?.z??vg}};var jw=[.03,1800],Zw=[.12,2600],Jw=110,_g=.2,Tc=class{clicks=0;buzzing=!1;context=null;buzzer=null;touching=!1;heard=!1;done=0;constructor(){for(let e of["pointerdown","keydown"])window.addEventListener(e,()=>this.wake(),{capture:!0,passive:!0})}hear(e){if(e?.contact===void 0)return;e.contact&&!this.touching&&(this.clicks+=1,this.heard=!0,this.click(...jw)),this.touching=e.contact;let t=e.contact&&!e.over,n=e.done??0;n>this.done&&(this.clicks+=n-this.done-(this.heard?1:0),this.heard=!1,this.click(...Zw)),this.done=n,t!==this.buzzing&&this.buzz(t),this.buzzing=t}wake(){this.context??=new AudioContext,this.context.state==="suspended"&&this.context.resume()}click(e,t){if(!this.context)return;let[n,i]=this.tone(t,"sine",_g),{currentTime:r}=this.context;i.gain.exponentialRampToValueAtTime(.001,r+e),n.start(),n.stop(r+e)}buzz(e){this.buzzer?.stop(),this.buzzer=null,!(!e||!this.context)&&([this.buzzer]=this.tone(Jw,"square",_g/4),this.buzzer.start())}tone(e,t,n){let i=this.context,[r,o]=[new OscillatorNode(i,{frequency:e,type:t}),new GainNode(i,{gain:n})];return r.connect(o).connect(i.destination),[r,o]}};var bg="http://www.w3.org/2000/svg",Qw={grasper:"M0 12H30M30 12Q38 3 56 6M34 9l3 3 3-4 3 3 3-4 3 3 3-3M30 12Q38 21 56 18M34 15l3-3 3 4 3-3 3 4 3-3 3 3",scissors:"M0 12H30M28 12L60 4Q50 13 32 14ZM28 12L60 20Q50 11 32 10Z",clip_applier:"M0 12H26M26 12Q30 4 40 5H58V9H40M26 12Q30 20 40 19H58V15H40",scalpel:"M0 12H28M28 8H40L62 12Q52 18 40 16H28Z",cautery:"M0 12H34M34 9H40V15H34ZM40 12H56V20H50"},Pi=(s,e="",t="")=>{let n=document.createElement(s);return e&&(n.className=e),t&&(n.textContent=t),n},Ac=class{constructor(e,t,n){this.app=t;this.console=n;this.window.dataset.id="tools",this.window.setAttribute("aria-label","Tools"),this.fulcrum.dataset.id="fulcrum-window",this.fulcrum.title="Choose whether the hands move the tips or the outer ends of the instruments",this.fulcrum.onclick=()=>n.toggleFulcrum();let i=Pi("h2","","Tools");i.append(this.fulcrum),this.window.append(i,...Qe.toReversed().map(r=>this.row(r))),e.append(this.window)}app;console;window=Pi("section","tools");buttons=[];does={right:Pi("p"),left:Pi("p")};fulcrum=Pi("button");shown="";refresh(){let{views:e,info:t}=this.console,n=this.app.model.console,i=e.beside,r=JSON.stringify([i,this.app.xr.presenting,n?.fulcrum,Qe.map(o=>n?.hands[o])]);if(r!==this.shown){this.shown=r,this.window.classList.toggle("low",i.height<150),this.window.classList.toggle("flat",i.height<110||e.flat);for(let[o,a]of Object.entries(i))this.window.style.setProperty(o,`${a}px`);for(let{side:o,tool:a,node:l}of this.buttons)l.setAttribute("aria-pressed",String(n?.hands[o]?.tool===a.name)),l.classList.toggle("carried",n?.hands[o]?.carries===a.name);for(let o of Qe){let a=t.tools.find(h=>h.name===n?.hands[o]?.tool),l=n?.hands[o],c=l?.active?"is switched on":a?.does??"";this.does[o].textContent=`${o==="right"?"Right":"Left"} hand: ${l?.waits??(a?`${a.title} \u2013 ${c}`:"")}`,this.does[o].dataset.tone=l?.waits?"warn":l?.active?"bad":"plain"}this.fulcrum.textContent=this.console.fulcrumText(),this.fulcrum.setAttribute("aria-pressed",String(n?.fulcrum==="direct"))}}row(e){let t=Pi("div","tool-row");t.dataset.side=e;for(let i of this.console.info.tools){let r=Pi("button","tool");r.dataset.id=`tool-${e}-${i.name}`,r.title=`${i.title}: ${i.does}`,r.append(eS(i.kind),Pi("span","",i.title)),r.onclick=()=>this.console.takeTool(e,i.name),this.buttons.push({side:e,tool:i,node:r}),t.append(r)}let n=Pi("div","tool-hand");return n.append(this.does[e],t),n}};function eS(s){let e=document.createElementNS(bg,"svg");e.setAttribute("viewBox","0 0 64 24"),e.setAttribute("aria-hidden","true");let t=document.createElementNS(bg,"path");return t.setAttribute("d",Qw[s]),e.append(t),e}var tS=2e-5,Ec=class{constructor(e){this.world=e;let t=new zn(1,1);this.picture=new Tt(1,1,{depthTexture:t,minFilter:gt,magFilter:gt}),Object.assign(this.picture,{isXRRenderTarget:!0}),this.picture.texture.colorSpace=ot,this.picture.texture.internalFormat="RGBA8";let n=new dn({uniforms:{color:{value:this.picture.texture},depth:{value:t}},vertexShader:"void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",fragmentShader:`
        uniform highp sampler2D color;
        uniform highp sampler2D depth;
        void main() {
          ivec2 at = ivec2(gl_FragCoord.xy);
          gl_FragColor = texelFetch(color, at, 0);
          gl_FragDepth = texelFetch(depth, at, 0).r;
        }`,depthFunc:nr,toneMapped:!1});this.sheet=new ue(new Vt(2,2),n),this.sheet.frustumCulled=!1}world;picture;sheet;flat=new Gn(-1,1,1,-1,0,1);size=new ye;drawn=[];last=[];forget(){this.drawn=[]}draw(e,t){let{renderer:n,scene:i}=this.world;n.getDrawingBufferSize(this.size);let r=t.filter(c=>![c.material].flat().some(h=>h.transparent)),o=[...this.size.toArray(),...r.map(c=>Number(nS(c))),...e.matrixWorld.elements,...e.projectionMatrix.elements],a=Ad(o,this.last);if(this.last=o,!a&&!Ad(o,this.drawn)){n.render(i,e);return}Ad(o,this.drawn)||(this.drawn=o,this.take(e,r));let{background:l}=i;n.autoClear=!1,i.background=null,n.render(this.sheet,this.flat),Mg(r,()=>n.render(i,e)),i.background=l,n.autoClear=!0}take(e,t){let{renderer:n,scene:i}=this.world,r=new Set(t),o=[];i.traverse(a=>{"material"in a&&!r.has(a)&&o.push(a)}),this.picture.setSize(this.size.x,this.size.y),n.setRenderTarget(this.picture),Mg(o,()=>n.render(i,e)),n.setRenderTarget(null)}};function Mg(s,e){let t=s.map(n=>n.layers.mask);for(let n of s)n.layers.mask=0;e(),s.forEach((n,i)=>n.layers.mask=t[i])}function nS(s){for(let e=s;e;e=e.parent)if(!e.visible)return!1;return!0}var Ad=(s,e)=>s.length===e.length&&s.every((t,n)=>Math.abs(t-e[n])<tS);var Rc=class{constructor(e){this.page=e;this.copy.className="copy",this.copy.dataset.id="copy",this.copy.setAttribute("aria-hidden","true"),this.copy.inert=!0}page;copy=document.createElement("div");copied=-1/0;show(e){document.documentElement.toggleAttribute("data-halves",e),e?this.page.after(this.copy):this.copy.remove(),this.copied=-1/0}refresh(){let e=performance.now();if(!this.copy.isConnected||e-this.copied<250)return;this.copied=e;let t=[...this.page.children].map(r=>r.cloneNode(!0));this.copy.replaceChildren(...t);let n=this.page.querySelectorAll("*"),i=this.copy.querySelectorAll("*");n.forEach((r,o)=>{let a=i[o];a&&(r instanceof HTMLCanvasElement&&a.getContext("2d")?.drawImage(r,0,0),(r instanceof HTMLSelectElement||r instanceof HTMLInputElement)&&(a.value=r.value),r.scrollTop&&(a.scrollTop=r.scrollTop))})}};var iS=10132122,sS=.006,rS=.08;function wg(s,e,t,n=rS){let i=2*n*Math.tan(e/2),r=new lt({color:iS,depthTest:!1,depthWrite:!1,toneMapped:!1}),o=new ue(new Vt(s*i,sS*i),r);return o.name="line",o.position.z=-n,o.renderOrder=1e3,o.layers.set(t),o}var oS=.4,Sg=200,Tg=600,aS=1e4,lS={room:"Patient and robots",scope:"Inside the abdomen"},cS=1.9,Ns=4,hS=56,Ag=128,uS=180,dS=275,fS=.3,pS=new De().setFromAxisAngle(new S(1,0,0),Math.PI),Cc=class{constructor(e,t,n,i){this.app=e;this.camera=t;this.headed=i;this.scope=new dt(Ri.radToDeg(t.view),1,.003,oS),this.eyes=new wc(t.stereo),this.backdrop=new Ec(e.world),this.halves=new Rc(n);for(let r of[this.scope,this.eyes.left,this.eyes.right])r.layers.enable(Ns);this.frame.className="inset",this.frame.dataset.id="inset",this.frame.append(this.small),this.label.className="inset-name",this.heading.className="inset-name heading",this.heading.dataset.id="heading",this.heading.hidden=!i,n.append(this.frame,this.label,this.heading),this.frame.onclick=()=>this.swap(),window.addEventListener("resize",()=>this.place())}app;camera;headed;large="scope";high=0;scope;backdrop;swapped=!1;stereo="one";eyes;halves;onlooker=new dt;frame=document.createElement("button");small=document.createElement("canvas");label=document.createElement("span");heading=document.createElement("span");drawn=-1/0;both=!1;shadows=!1;mount(){let t=this.app.members.find(u=>u.model.info?.name===this.camera.robot)?.robot?.links.get(this.camera.link)?.node;if(!t)return;let{p:n,q:i}=Mn(this.camera.T_link_camera);this.scope.position.copy(n),this.scope.quaternion.copy(i).multiply(pS),t.add(this.scope);for(let u of this.app.members)u.handle.group.visible=!1;let r=new xs(16777215,2.6,.5,.9,.6,0),o=new vs(16769232,.9);r.position.set(0,0,0),r.target.position.set(0,0,-.1);for(let u of[r,o])u.layers.set(Ns);this.scope.add(r,r.target,o);let{line:a,view:l,stereo:c}=this.camera;a!==void 0&&this.scope.add(wg(a,l,Ns,c?.[1]));let{world:h}=this.app;this.onlooker=h.camera.clone(),this.onlooker.clearViewOffset(),h.placement.attach(this.onlooker),this.place()}swap(){this.large=this.large==="scope"?"room":"scope",this.place(),this.app.refresh()}get twoLenses(){return this.camera.stereo!==void 0}get mode(){return this.stereo}setMode(e){this.stereo=e,this.halves.show(e==="halves"),this.app.world.pace.exact=e==="rows",this.place(),this.app.world.touch(),this.app.refresh()}swapRows(){this.swapped=!this.swapped,this.app.world.touch(),this.app.refresh()}box(e){let{clientWidth:t,clientHeight:n}=this.app.world.renderer.domElement;if(e===this.large)return{left:0,top:0,width:t,height:n};let[i,r]=this.app.world.free(),o=window.innerWidth>1400?420:dS,a=Math.round(Math.min(fS*i,o,.6*r)),l=Math.round(.62*a);return{left:18,top:r-l-(this.headed&&!this.flat?40:18),width:a,height:l}}get corner(){return this.box(this.large==="scope"?"room":"scope")}get beside(){let e=this.corner,[t]=this.app.world.free(),n=e.left+e.width+12;return t-n-12>=260?{left:n,top:e.top,width:t-n-12,height:e.height}:{left:e.left,top:e.top-Ag-10,width:t-2*e.left,height:Ag}}get flat(){return window.innerHeight<=480}get low(){return this.headed?Math.min(this.corner.top,this.beside.top):this.corner.top}get free(){return this.app.world.free()}at(e,t){let n=this.large==="scope"?"room":"scope",i=this.box(n);return this.stereo==="halves"&&(e=2*(e%(window.innerWidth/2))),e>=i.left&&t>=i.top&&e<i.left+i.width&&t<i.top+i.height?n:this.large}place(){let e=this.large==="scope"?"room":"scope",t=this.box(e);for(let[a,l]of Object.entries(t))this.frame.style.setProperty(a,`${l}px`);this.frame.classList.toggle("work",e==="scope"),this.label.style.left=`${t.left+8}px`,this.label.style.top=`${t.top+4}px`,this.label.style.maxWidth=`${t.width-16}px`;let n=this.camera.name==="microscope"?"Microscope":"Endoscope",i=this.headed?lS:{room:"Room",scope:n},r=e==="room"?`${i.room} \xB7 click to enlarge`:i.scope;this.label.textContent=t.width<uS?i[e]:r,this.heading.textContent=this.large==="scope"?`${i.scope}, through the endoscope`:i.room;let o=Math.min(this.app.world.free()[0],this.app.dom.left);this.heading.style.maxWidth=`${Math.max(0,o-this.heading.offsetLeft-12)}px`,this.frame.setAttribute("aria-label",r)}project(e,t,n=0){let i=this.sideBySide(t);if(!i)return this.into(e,this.fit(t),this.box(t));this.follow(i);let[r,o]=Xn.map(a=>this.into(e,this.eyes[a],i[a]));return n<i.right.left?r:o}into(e,t,n){let i=e.clone().project(t);return{x:n.left+n.width*(1+i.x)/2,y:n.top+n.height*(1-i.y)/2}}pixels(e){let t=e==="scope"?this.camera.view:Ri.degToRad(this.app.world.camera.fov),n=this.sideBySide(e);return(e==="scope"&&(!n||this.stereo==="halves")?this.fit(e).zoom:1)*(n?.left??this.box(e)).height/(2*Math.tan(t/2))}sideBySide(e){if(e!=="scope"||this.large!=="scope"||this.stereo!=="side"&&this.stereo!=="halves")return null;let t=this.box(e),[n,i]=this.stereo==="side"?this.app.world.free():[t.width,t.height],r=Math.floor(n/2),o=a=>({left:a,top:0,width:r,height:i});return{left:o(0),right:o(r)}}follow(e){this.stereo==="side"?this.aim(e.left.width/e.left.height):(this.fit("scope"),this.eyes.follow(this.scope))}render(){let{pace:e,renderer:t,moved:n}=this.app.world,i=this.large==="scope"?"room":"scope",r=performance.now();this.shadows||=t.shadowMap.needsUpdate;let o=!this.both&&r-this.drawn>(e.slow&&r-n<Tg?aS:Sg);if(this.both=o,i==="scope"||o){o&&e.except(),this.drawn=r,this.drawLit(i);let{left:a,top:l,width:c,height:h}=this.box(i),u=t.getPixelRatio(),[d,f]=[Math.round(c*u),Math.round(h*u)];(this.small.width!==d||this.small.height!==f)&&([this.small.width,this.small.height]=[d,f]),this.small.getContext("2d")?.drawImage(t.domElement,a*u,l*u,d,f,0,0,d,f)}else this.app.later(e.slow?Tg:Sg);this.drawLit(this.large),this.halves.refresh()}drawEyes(e,t){this.aim(e/t);let n={left:this.eyes.picture("left",e,t),right:this.eyes.picture("right",e,t)},{reflections:i}=this.app.world;return i.inside(()=>{for(let r of Xn)this.drawInto(n[r],this.eyes[r],!0)}),n}drawRoom(e){this.onlooker.aspect=e.width/e.height,this.onlooker.updateProjectionMatrix(),this.onlooker.updateWorldMatrix(!0,!1),this.drawInto(e,this.onlooker,!1)}drawInto(e,t,n){let{renderer:i,scene:r,placement:o}=this.app.world,l=[...r.children.filter(g=>g!==o&&g.visible&&!("isLight"in g)),...n?this.about():[]],[c,h,u]=[i.xr.enabled,r.background,o.visible],[d,f]=[i.getRenderTarget(),i.shadowMap.needsUpdate];i.shadowMap.needsUpdate=!1;for(let g of l)g.visible=!1;o.visible=!0,i.xr.enabled=!1,r.background=this.app.world.sky,i.setRenderTarget(e),i.clear(),i.render(r,t),i.setRenderTarget(d),i.shadowMap.needsUpdate=f,i.xr.enabled=c,r.background=h,o.visible=u;for(let g of l)g.visible=!0}drawLit(e){e==="scope"?this.app.world.reflections.inside(()=>this.draw(e)):this.draw(e)}draw(e){let{renderer:t,scene:n}=this.app.world,i=this.box(e);if(i.width<1||i.height<1)return;t.shadowMap.needsUpdate=e==="room"&&this.shadows,e==="room"&&(this.shadows=!1);let r=e==="scope"?this.about():[];for(let a of r)a.visible=!1;let o=this.sideBySide(e);if(t.setScissorTest(!0),o){this.inBox(i,()=>t.clear()),this.follow(o);for(let a of Xn)this.inBox(o[a],()=>t.render(n,this.eyes[a]))}else if(e==="scope"&&e===this.large&&(this.stereo==="red-cyan"||this.stereo==="rows")){let a=this.stereo;this.fit(e),this.eyes.follow(this.scope);let l=t.getPixelRatio();for(let c of Xn)t.setRenderTarget(this.eyes.picture(c,Math.round(i.width*l),Math.round(i.height*l))),t.render(n,this.eyes[c]);t.setRenderTarget(null),this.inBox(i,()=>this.eyes.overlay(t,a,this.swapped))}else{let a=this.fit(e),l=e==="scope"&&e===this.large&&this.app.world.pace.reduced;this.inBox(i,()=>l?this.backdrop.draw(a,this.still()):t.render(n,a))}t.setScissorTest(!1),t.setViewport(0,0,t.domElement.clientWidth,t.domElement.clientHeight);for(let a of r)a.visible=!0}inBox({left:e,top:t,width:n,height:i},r){let{renderer:o}=this.app.world,a=[e,o.domElement.clientHeight-t-i,n,i];o.setViewport(...a),o.setScissor(...a),r()}still(){return[...this.app.world.ground,...this.app.surroundings.parts,...this.app.drawn.still]}about(){let{members:e,surroundings:t}=this.app;return[...e.flatMap(i=>i.place.children.filter(r=>r!==i.robot?.root)),...t.signs].filter(i=>i.visible)}aim(e){this.scope.aspect=e,this.scope.zoom=1,this.scope.clearViewOffset(),this.scope.updateWorldMatrix(!0,!1),this.eyes.follow(this.scope)}fit(e){let{world:t}=this.app,n=e==="scope"?this.scope:t.camera,i=this.box(e),[r,o]=t.free(),a=e===this.large;n.aspect=i.width/i.height;let l=this.headed?this.low:o,c=r-t.beside,h=this.flat&&!this.headed?hS:this.high,[u,d]=a?[(i.width-r-t.beside)/2,(i.height-l-h)/2]:[0,0],f=Math.min(c/(this.headed?this.corner.top:o),this.flat?(l-h)/o:1);return e==="scope"?n.zoom=a?Math.min(1,f):1:n.zoom=a||!this.headed?1:cS,n.setViewOffset(i.width,i.height,u,d,i.width,i.height),e==="scope"&&this.scope.updateWorldMatrix(!0,!1),n}};var Eg=.08,Ed=.5,mS=.001,gS=800,Rd=2.5,xS=.8,yS=8e3,Pc=class{constructor(e,t,n){this.app=e;this.info=n;let{model:i,line:r}=e;this.sides=Qe.filter(l=>n.hands[l].length>0),this.pens=new ql(r,()=>i.console,()=>i.client,this.enables?["clutch"]:["clutch","camera"]);let o=t.cameras.find(l=>l.name===n.camera),a=document.getElementById("page");this.views=new Cc(e,o,a,n.tools.length>0),this.sound=new Tc,this.forms=new Ql(a,e,n.questionnaires);for(let[l,c]of n.marks)this.mark(l,c);this.tools=n.tools.length?new Ac(a,e,this):null,this.forces=new Jl(e,this),this.plan=new _c(a,e,this),this.keys=new tc(this),this.pad=new ic(this),this.screen=new Sc(e,this.views),this.heads=new Mc(e,this),this.hands=new $l(e,this),new jl(e,this),new Zl(e,this),i.atConsole=()=>this.status()}app;info;pens;views;keys;pad;screen;heads;hands;forces;plan;tools;sides;sound;forms;chosen="right";wheel=0;ended="";slowUntil=NaN;mark(e,t){let n=new sn;n.say(e,"#17212e","normal",mS),n.sprite.name=`mark ${e}`,n.sprite.center.set(.5,-.6),n.sprite.position.fromArray([...Array.from(t)]),n.sprite.layers.set(Ns),n.sprite.visible=!0,this.app.world.robotWorld.add(n.sprite)}get enables(){return this.info.pedal==="enable"}get help(){return this.enables?"Drag in the picture: the instrument follows. More behind ?":"Drag in the picture: the nearest instrument follows. More behind ?"}get perPixel(){let e=this.enables?this.info.first_scale:Ed;return this.reach/e/this.views.pixels("scope")}get reach(){let e=this.enables?this.tip("right"):null;return e?e.distanceTo(this.views.scope.getWorldPosition(new S))/this.views.scope.matrixWorld.getMaxScaleOnAxis():Eg}enable(e,t){this.enables&&this.pens.press("clutch",e,t)}notch(e,t,n,i,r){this.enables&&!this.pens.clutch&&this.pens.press("clutch","wheel",!0),this.pens.presses("clutch","wheel")&&(window.clearTimeout(this.wheel),this.wheel=window.setTimeout(()=>this.pens.press("clutch","wheel",!1),gS)),t?this.turn(e,0,0,-r*n):this.move(e,0,0,i*n)}move(e,t,n,i){if(this.lead(e),this.pens.camera)for(let r of Qe)this.pens[r].move(Rd*t,Rd*n,Rd*i);else this.pens[e].move(t,n,i)}turn(e,t,n,i){this.lead(e),this.pens.camera?this.roll(i||-n):this.pens[e].turn(t,n,i)}zoom(e){this.move(this.chosen,0,0,Eg/Ed*(1-1/e))}nearest(e,t){if(this.sides.length===1)return"right";let n=this.plan.state?.hand;if(n)return n;let i=r=>{let o=this.tip(r);if(!o)return 1/0;let a=this.views.project(o,"scope",e);return Math.hypot(a.x-e,a.y-t)};return i("right")<=i("left")?"right":"left"}works(e,t){return!this.app.xr.presenting&&this.views.at(e,t)==="scope"}toggle(e){let t=!this.pens.presses(e,"button");t&&this.lift(),this.pens.press(e,"button",t)}lift(){for(let e of["clutch","camera"])this.pens.press(e,"button",!1)}called(e){return this.info.called[e]??e}squeeze(e,t){this.lead(e),this.pens[e].squeeze(t)}jawLabel(e){let t=e==="right"?"Right":"Left",n=this.app.model.console?.hands[e]?.carries,i=this.info.tools.find(r=>r.name===n)?.kind==="cautery";return`${t} ${i?"energy":"jaw"}`}toggleJaw(e){this.squeeze(e,this.pens[e].grip>0?0:1)}toggleHaptics(){this.app.ask("haptics",{on:!this.haptics})}get haptics(){return this.app.model.console?.haptics??!1}toggleFulcrum(){this.info.fulcrum&&this.app.ask("fulcrum",{mode:this.app.model.console?.fulcrum==="direct"?"compensated":"direct"})}fulcrumText(){return this.app.model.console?.fulcrum==="direct"?"Fulcrum direct: the tip moves against the hand":"Fulcrum compensated: the tip moves with the hand"}takeTool(e,t){this.app.ask("tool",{hand:e,name:t})}nextTool(e){let{tools:t}=this.info,n=t.findIndex(r=>r.name===this.app.model.console?.hands[e]?.tool),i=t[(n+1)%t.length];i&&this.takeTool(e,i.name)}setScale(e){let[t,n]=this.info.scale;this.app.ask("scale",{value:Math.min(n,Math.max(t,e))})}get scale(){return this.app.model.console?.scale??Ed}update(e){this.keys.update(e),this.pad.update(e),this.pens.say(e),this.forces.update(),this.plan.update(e),this.sound.hear(this.app.model.console?.task??null),this.forms.refresh()}tip(e){let t=this.app.model.console?.hands[e]?.robot??this.info.hands[e][0],n=this.app.members.find(o=>o.model.info?.name===t),i=n?.model.info?.tool,r=i&&n.robot?.links.get(i.link)?.node;return r?new S().fromArray(i.T_link_tool).applyMatrix4(r.matrixWorld):null}walls(){let e=this.app.model.console;return e?[...this.sides.map(t=>e.hands[t]?.wall),e.camera].filter(Boolean).length:0}say(e){this.app.model.say(e)}handText(e){let t=this.app.model.console?.hands[e];if(!t)return"";let n=Cd(this.called(t.robot).replace(/^the /,""));if(t.waits)return`${n}: ${t.waits}`;let i=this.plan.phase==="aim"&&t.follows;return t.wall?`${n}: ${t.wall}`:`${n} ${i?"is at rest; its target follows":t.follows?"follows the hand":"is at rest"}`}lead(e){this.chosen=e,this.pens.use()}roll(e){let{right:t,left:n}=this.pens,i=t.p.clone().add(n.p).divideScalar(2),r=new S(0,0,1);for(let o of Qe){let a=this.pens[o].p.clone().sub(i),l=a.clone().applyAxisAngle(r,e).sub(a);this.pens[o].move(l.x,l.y,l.z)}}status(){let e=this.app.model.console;if(!e)return null;if(e.stopped)return{tone:"bad",text:`The simulation has stopped: ${e.stopped}`};if(this.forms.due)return{tone:"warn",text:this.forms.due};if(e.task?.over)return{tone:Sd(e.task),text:`${e.task.over} Press Restart to begin again.`};let t=this.plan.status();if(t)return t;let n=e.owner==="udp";if(!n&&e.owner!==null&&e.owner!==this.app.model.client&&!e.silent)return{tone:"warn",text:`Client ${e.owner} controls the hands: you can only watch.`};if(!this.pens.active&&!n)return this.broker()??this.atRest(e);let r=n?[]:this.sides.filter(h=>this.pens.lost.has(h));if(r.length)return{tone:"warn",text:`The ${r.join(" and the ")} hand is not tracked: nothing moves until it is tracked.`};if(e.silent)return{tone:"warn",text:`${this.missing(n)}: nothing moves.`};if(e.pedal)return{tone:"warn",text:vS(e.pedal)};let o=this.atLimit(e);if(o)return{tone:"warn",text:o};if(e.camera)return{tone:"warn",text:`Camera: ${e.camera}`};let a=this.slowText(e);if(a)return{tone:"plain",text:a};if(e.mode==="nothing"&&this.enables)return{tone:"good",text:"The pedal is up: only the hand moves; the robot is at rest."};if(e.mode==="nothing")return{tone:"good",text:"Clutch: only the hands move; the instruments are at rest."};if(e.mode==="camera")return{tone:"good",text:"Camera: both hands move the picture."};let l=this.sides.flatMap(h=>e.hands[h]?.follows?[this.called(e.hands[h].robot)]:[]),c=n?"UDP packets control":"You control";return n&&!l.length?{tone:"good",text:"UDP packets control the hands: roll a handle or open a gripper to start."}:l.length?{tone:"good",text:`${c} ${l.join(" and ")}.`}:this.nextStep(e)}atRest(e){return this.ended?{tone:"warn",text:this.ended}:this.nextStep(e)}nextStep(e){return e.task?.next?{tone:"plain",text:e.task.next}:null}atLimit(e){for(let t of this.sides){let n=e.hands[t];if(n?.wall)return this.ended=`${Cd(this.called(n.robot))} stops: ${n.wall}`,this.ended}return this.ended="",""}slowText(e){if(e.rate>=xS)return"";let t=performance.now();return Number.isNaN(this.slowUntil)&&(this.slowUntil=t+yS),t>this.slowUntil?"":`This computer simulates at ${e.rate}\xD7 real time: motions take longer than in reality.`}broker(){let e=this.app.model.console?.mqtt;return e&&!e.connected&&e.problem?{tone:"warn",text:e.problem}:null}missing(e){let t=this.app.model.console?.packets?.from;return!e||!t?"The server receives no state of the hands":`No packets of the ${this.sides.filter(i=>t[i]===null).join(" and the ")||"right"} hand`}},Cd=s=>`${s.charAt(0).toUpperCase()}${s.slice(1)}`,vS=s=>`${Cd(s)}.`;var Vo=17,wn=7,_S=.5,Id=new S(-.79,-.61,0),Ic=class{constructor(e){this.world=e;this.person.visible=!1,e.robotWorld.add(this.person)}world;on=!0;personal=!1;person=new Pe;parts=[];fixed=[];cables=[];info=null;figure=null;get notes(){return this.info&&this.on?this.info.notes.join(`
`):""}get any(){return this.info!==null}async load(e,t,n){let i=e.drawn;if(i){for(let{body:r,color:o,pattern:a}of i.finishes)n.finish(r,o,a==="tissue");if(i.file){let r=ns((await oi(i.file)).scene);for(let{node:o,robot:a,link:l,pattern:c}of i.parts){let h=r.find(d=>d.name===o),u=a===null?this.world.robotWorld:Rg(t,a,l);!h||!u||(h.traverse(d=>Cg(d,c==="tissue")),u.add(h),(a===null?this.fixed:this.parts).push(h))}}for(let r of i.cables)this.hang(r,t);this.info=i,this.update()}}show(e,t){this.on=e;for(let n of this.parts)n.visible=e;for(let n of this.fixed)n.visible=e&&t;for(let{mesh:n}of this.cables)n.visible=e;this.update(),this.world.touch()}get still(){let e=[];for(let t of this.fixed)t.traverse(n=>n instanceof ue&&e.push(n));return e}update(){if(this.on)for(let e of this.cables)bS(e)}async stand(e,t,n){this.personal=t,t&&e&&(this.figure??=this.fetch(e.file),await this.figure);let i=n.getCenter(new S),r=n.getSize(new S);this.person.position.copy(i).addScaledVector(Id,.5*Math.hypot(r.x,r.y)+_S),this.person.position.z=n.min.z,this.person.rotation.z=Math.atan2(-Id.y,-Id.x),this.person.visible=this.personal,this.world.touch()}box(){let e=new vt;return this.person.visible?(this.world.robotWorld.updateMatrixWorld(!0),e.setFromObject(this.person).applyMatrix4(this.world.robotWorld.matrixWorld.clone().invert())):e}async fetch(e){let t=ns((await oi(e)).scene);for(let n of t)n.traverse(i=>Cg(i,!1));this.person.add(...t)}hang(e,t){let n=t.find(d=>d.model.info?.name===e.robot),[i,r]=e.ends.map(({link:d})=>Rg(t,e.robot,d));if(!n||!i||!r)return;let[o,a,l]=e.color,c=new ve().setRGB(o??0,a??0,l??0),h=new ue(wS(),new Mt({color:c,roughness:.7,metalness:0}));h.frustumCulled=!1,n.place.add(h);let u=()=>new S(1/0,0,0);this.cables.push({info:e,member:n,nodes:[i,r],mesh:h,drawn:[u(),u()]})}};function Rg(s,e,t){let n=s.find(i=>i.model.info?.name===e);return t===null?void 0:n?.robot?.links.get(t)?.node}function Cg(s,e){if(!(s instanceof ue))return;let t=s;t.receiveShadow=!0,t.material=t.material.clone(),t.material.side=It,e&&(Pr(t.geometry),t.material.map=Cr(),t.material.roughness=.5)}function bS(s){let{info:e,member:t,nodes:n,mesh:i,drawn:r}=s,[o,a]=n.map((l,c)=>{let h=new S().fromArray(e.ends[c].at);return l.updateMatrix(),h.applyMatrix4(l.matrix)});o.distanceTo(r[0])<1e-6&&a.distanceTo(r[1])<1e-6||(s.drawn=[o,a],SS(i.geometry,MS(o,a,e.length),e.radius),i.visible=t.robot!==null)}function MS(s,e,t){let n=s.distanceTo(e),i=t-n,r=i>0?Math.min(Math.sqrt(3/8*n*i)+.25*i,.5*t):0;return Array.from({length:Vo},(o,a)=>{let l=a/(Vo-1),c=s.clone().lerp(e,l);return c.z-=4*l*(1-l)*r,c})}function wS(){let s=new Ye,e=[];for(let t=0;t+1<Vo;t++)for(let n=0;n<wn;n++){let[i,r]=[t*wn+n,t*wn+(n+1)%wn];e.push(i,r,r+wn,i,r+wn,i+wn)}return s.setIndex(e),s.setAttribute("position",new Ue(3*Vo*wn,3)),s.setAttribute("normal",new Ue(3*Vo*wn,3)),s}function SS(s,e,t){let n=s.getAttribute("position"),i=s.getAttribute("normal"),[r,o,a,l]=[new S,new S,new S,new S];e.forEach((c,h)=>{let u=e[Math.max(0,h-1)],d=e[Math.min(e.length-1,h+1)];r.subVectors(d,u).normalize(),h===0&&(o.set(-r.y,r.x,0),o.lengthSq()<1e-8&&o.set(1,0,0)),o.addScaledVector(r,-o.dot(r)).normalize(),a.crossVectors(r,o);for(let f=0;f<wn;f++){let g=2*Math.PI*f/wn;l.copy(o).multiplyScalar(Math.cos(g)).addScaledVector(a,Math.sin(g)),i.setXYZ(h*wn+f,l.x,l.y,l.z),n.setXYZ(h*wn+f,c.x+t*l.x,c.y+t*l.y,c.z+t*l.z)}}),n.needsUpdate=i.needsUpdate=!0}var TS=1e3/70,Lc=class{constructor(e,t,n){this.world=e;this.members=t;this.line=n;this.ghostHand=new ue(new Hn(1,20,12),At(Ps,.6)),this.thread=new In(new Ye().setFromPoints([new S,new S]),new uo({color:Ps,depthTest:!1,toneMapped:!1,dashSize:.01,gapSize:.006})),this.thread.frustumCulled=!1,this.thread.renderOrder=6;let i=At(Ps,.3);i.side=It,i.depthWrite=!1,this.wall=new ue(new Xi(1,48),i),this.wall.renderOrder=5,this.ghostHand.visible=this.thread.visible=this.wall.visible=!1}world;members;line;mode="auto";turning=!1;held=null;onChange=()=>{};ghostHand;thread;wall;label=new sn;wanted=null;pending=null;sentAt=0;hovered=null;hover(e){if(this.held)return;let t=e?e.link??e.member.model.info?.tool.link??"":"";this.hovered!==(e?.member??null)&&this.hovered?.robot?.mark("","none")&&this.world.touch(),this.hovered=e?.member??null,e?.member.robot?.mark(t,t?"hover":"none")&&this.world.touch()}start({member:e,link:t,point:n},i=this.mode){let r=e.model.info;if(!r||!e.robot||this.held)return!1;let o=t??r.tool.link,a=t===null||i==="auto"&&o===r.tool.link,l=!a&&i==="joint"?AS(r.joints,o):void 0;return!a&&i==="joint"&&!l?(e.model.say(`No active joint moves ${o}.`),!1):this.take(e,a?"tool":l?"joint":"link",o,n,l)}startJoint(e,t){return this.take(e,"joint",t.link,new S,t)}take(e,t,n,i,r){let{model:o,robot:a}=e,l=a?.links.get(n)?.node,c=a?yc(o,a):null;if(!l||!c||this.held)return!1;if(o.page.line!=="open")return o.say("There is no connection: the robot cannot be moved."),!1;let h=e.place.worldToLocal(i.clone()),u=h.clone().applyMatrix4(new _e().compose(l.position,l.quaternion,Pg).invert()),d={p:new S,q:new De};c.decompose(d.p,d.q,new S);let f=r?o.joint(r.name):0,g={member:e,target:t,link:n,joint:r,from:h,local:u,tool:d,value:f,last:0,axis:ES(e,r),sent:!1,granted:!1};this.held=g,this.hovered=null,o.holding=!0,o.stopped="",e.place.add(this.ghostHand,this.thread,this.wall,this.label.sprite);let y=t==="tool"?{target:t}:t==="joint"?{target:t,name:r?.name}:{target:t,name:n,point:u.toArray()};return this.line.ask("grab",o.fields("grab",y)).then(p=>{p.ok?g.granted=!0:this.held===g&&this.drop(p.code==="held"?`${p.message}.`:p.message)}),this.onChange(),!0}move(e,t){let n=this.held;if(!n)return;let i=n.member.place.worldToLocal(e.clone());if(this.wanted=i.clone(),n.target==="tool"){let r=n.member.place.getWorldQuaternion(new De),o=r.clone().invert().multiply(t).multiply(r),a=n.tool.p.clone().sub(n.from).applyQuaternion(o).add(i),l=o.multiply(n.tool.q).normalize();this.pending={pose:Ym(a,l)},this.wanted=a}else n.target==="joint"?this.pending={value:this.jointValueAt(n,i)}:this.pending={point:i.toArray()};this.flush()}moveJoint(e){this.wanted=null,this.pending={value:e},this.flush()}end(){this.held&&(this.flush(!0),this.line.ask("release",this.held.member.model.fields("release",{})),this.drop(""))}drop(e){let t=this.held?.member;this.held=null,this.pending=this.wanted=null,t&&(t.model.holding=!1,t.robot?.mark("","none"),e&&t.model.say(e)),this.onChange()}update(){this.flush();for(let e of this.members)this.draw(e)}draw(e){let{model:t,robot:n,handle:i}=e,r=this.held?.member===e?this.held:null,o=n?yc(t,n):null;if(!n||!o)return;i.group.visible=t.page.line==="open";let a=r!==null&&t.refused,l=a&&r?.target!=="joint";r&&n.mark(r.link,a&&!l?"refused":"held"),i.put(o,.026*e.size,a?Ps:t.heldByOther?9081760:jt),(r||!this.held)&&this.drawGhostHand(a,o)}drawGhostHand(e,t){let n=this.held,i=e&&n!==null&&this.wanted!==null;if(this.ghostHand.visible=this.thread.visible=this.wall.visible=i,this.label.sprite.visible=i,!i)return;let r=n.member.size,o=this.wanted,a=n.member.robot?.links.get(n.link)?.node,l=n.target==="tool"||!a?new S().setFromMatrixPosition(t):n.local.clone().applyMatrix4(new _e().compose(a.position,a.quaternion,Pg));this.ghostHand.position.copy(o),this.ghostHand.scale.setScalar(.018*r);let c=o.clone().sub(l);this.wall.visible=c.length()>CS,this.wall.position.copy(l),this.wall.scale.setScalar(.11*r),this.wall.visible&&this.wall.quaternion.setFromUnitVectors(RS,c.normalize());let h=this.thread.geometry.getAttribute("position");h.setXYZ(0,l.x,l.y,l.z),h.setXYZ(1,o.x,o.y,o.z),h.needsUpdate=!0,this.thread.computeLineDistances(),this.label.sprite.position.copy(o).addScaledVector(PS,.03*r);let u=n.target==="joint"?"":`
${Wt(o.distanceTo(l))} short`;this.label.say(`cannot follow${u}`,"#b3101e",this.world.look,.026*r)}flush(e=!1){let t=performance.now(),n=this.held;!n||!this.pending||!e&&t-this.sentAt<TS||this.line.tell("drag",n.member.model.fields("drag",this.pending))&&(this.sentAt=t,n.sent=!0,this.pending=null)}jointValueAt(e,t){let{o:n,d:i}=e.axis;if(!e.joint||!ts(e.joint))return e.value+t.clone().sub(e.from).dot(i);let r=e.from.clone().sub(n).projectOnPlane(i),o=t.clone().sub(n).projectOnPlane(i),a=Math.atan2(r.clone().cross(o).dot(i),r.dot(o));return a+=2*Math.PI*Math.round((e.last-a)/(2*Math.PI)),e.last=a,e.value+a}};function AS(s,e){let t=new Set,n=[e];for(;n.length;){let i=s.filter(o=>n.includes(o.link)),r=i.find(o=>o.active);if(r)return r;n.forEach(o=>t.add(o)),n=i.map(o=>o.parent).filter(o=>!t.has(o))}}function ES(s,e){let t=new S,n=new S(0,0,1),i=e?s.robot?.links.get(e.parent)?.node:void 0;return e&&i&&(t.fromArray(e.axis.origin).applyQuaternion(i.quaternion).add(i.position),n.fromArray(e.axis.direction).applyQuaternion(i.quaternion).normalize()),{o:t,d:n}}var Pg=new S(1,1,1),RS=new S(0,0,1),CS=5e-4,PS=new S(0,0,1);var Ig=.035;function Wo(s,e){return Dc(e,t=>IS(s,t))??Dc(e,t=>LS(s,t))}function Lg(s,e){return Dc(e,t=>DS(s,t))??Dc(e,t=>NS(s,t))}function Dc(s,e){let t=null;for(let n of s){let i=n.robot?e(n):null;i&&(!t||i.distance<t.distance)&&(t=i)}return t}function IS(s,e){let{group:t,ball:n}=e.handle,i=t.visible?s.intersectObject(n,!1)[0]:void 0;return i?{member:e,link:null,point:t.getWorldPosition(new S),distance:i.distance}:null}function LS(s,e){let t=s.intersectObjects(e.robot?.targets()??[],!1)[0],n=t?e.robot?.linkOf(t.object)??null:null;return t&&n!==null?{member:e,link:n,point:t.point,distance:t.distance}:null}function DS(s,e){let{group:t}=e.handle,n=t.getWorldPosition(new S).distanceTo(s),i=t.getWorldScale(new S).x;return t.visible&&n<i+Ig?{member:e,link:null,point:s.clone(),distance:n}:null}function NS(s,e){let t=e.robot?.nearest(s);return t&&t.distance<Ig?{member:e,link:t.link,point:s.clone(),distance:t.distance}:null}function Nc(s,e){return e.ray.origin.setFromMatrixPosition(s),e.ray.direction.set(0,0,-1).transformDirection(s),e}var OS=4,Dg=1400,US=.02,Oc=class{constructor(e,t,n){this.ray=e;this.grip=t;this.hand=n;this.beam=new In(new Ye().setFromPoints([new S,new S(0,0,-1)]),Ci(new Ot({transparent:!0,opacity:.7,toneMapped:!1}))),this.beam.visible=!1,this.beam.frustumCulled=!1,e.add(this.beam),this.dot=new ue(new Hn(.006,12,8),Ci(At(jt))),this.dot.visible=!1}ray;grip;hand;source=null;doing="nothing";first=new _e;local=new S;near=!1;pointsAtPanel=!1;last=new S;beam;dot;pinch(){let e=this.hand.joints,[t,n]=[e?.["index-finger-tip"],e?.["thumb-tip"]];return!this.source?.hand||!t?.visible||!n?null:t.getWorldPosition(new S).add(n.getWorldPosition(new S)).multiplyScalar(.5)}pose(){if(!this.near)return this.ray.matrixWorld;let e=this.pinch(),t=this.grip.matrixWorld.clone();return e?t.setPosition(e):t}},Uc=class{constructor(e){this.app=e;let{renderer:t,scene:n}=e.world;for(let i=0;i<OS;i++){let r=new Oc(t.xr.getController(i),t.xr.getControllerGrip(i),t.xr.getHand(i));n.add(r.ray,r.grip,r.hand,r.dot),this.listen(r),this.hands.push(r)}this.gazeHand=new Oc(this.gaze,this.gaze,new Pe),n.add(this.gaze),this.cursor=new ue(new qi(.006,.011,24,1,0,2*Math.PI),Ci(At(jt))),this.cursor.visible=!1,this.cursor.renderOrder=12,this.cursor.material.depthTest=!1,n.add(this.cursor)}app;hands=[];caster=new _s;two=!1;gaze=new Pe;cursor;gazeHand;dwell={id:"",at:new S,since:0,done:!1};get count(){return this.hands.filter(e=>e.source).length}get pointing(){return this.hands.flatMap(t=>t.source?.targetRayMode==="tracked-pointer"?[t.source]:[]).sort((t,n)=>+(n.handedness==="right")-+(t.handedness==="right"))}usesPanel(e){return this.hands.some(t=>t.source?.handedness===e&&(t.doing==="panel"||t.pointsAtPanel))}update(e){if(this.app.xr.presenting){for(let t of this.hands)t.source&&this.follow(t);this.pair(),this.look(e)}}forget(){for(let e of[...this.hands,this.gazeHand])this.stop(e),e.beam.visible=e.dot.visible=!1;this.cursor.visible=!1}listen(e){e.ray.addEventListener("connected",t=>{e.source=t.data;let n=e.source.targetRayMode==="tracked-pointer";e.beam.visible=n,this.app.refresh()}),e.ray.addEventListener("disconnected",()=>{this.stop(e),e.source=null,e.beam.visible=e.dot.visible=!1,this.app.refresh()}),e.ray.addEventListener("selectstart",()=>this.start(e)),e.ray.addEventListener("selectend",()=>this.stop(e)),e.ray.addEventListener("squeezestart",()=>{e.doing==="nothing"&&!this.app.console&&this.begin(e,"move")}),e.ray.addEventListener("squeezeend",()=>{e.doing==="move"&&this.stop(e)})}start(e){let{app:t}=this;if(e.doing!=="nothing")return;let n=Nc(e.ray.matrixWorld,this.caster),i=n.intersectObject(t.xrPanel.mesh,!1)[0];if(i?.uv&&t.xrPanel.group.visible){e.doing="panel",t.xrPanel.press(i.uv);return}if(t.console)return;if(t.place.placing&&t.place.reticle.visible){t.place.putAt(new S().setFromMatrixPosition(t.place.reticle.matrix),t.xr.viewer());return}let r=e.pinch(),o=r?Lg(r,t.members):null,a=o??Wo(n,t.members);if(t.place.moving||!a)return this.begin(e,t.place.moving?"move":"free");t.take(a)&&(e.doing="grab",e.near=o!==null,e.first.copy(e.pose()),e.local.copy(a.point).applyMatrix4(e.first.clone().invert()))}begin(e,t){e.doing=t,e.last.copy(this.where(e))}stop(e){e.doing==="panel"&&this.app.xrPanel.release(),e.doing==="grab"&&this.app.grab.end(),e.doing="nothing",e.near=!1}follow(e){let{app:t}=this,n=Nc(e.ray.matrixWorld,this.caster),i=t.xrPanel.group.visible?n.intersectObject(t.xrPanel.mesh,!1)[0]:void 0;if(e.pointsAtPanel=i!==void 0,e.doing==="nothing"&&t.xrPanel.hover(i?.uv??null),e.doing==="panel"){let a=this.onPanel(n);a&&t.xrPanel.drag(a)}if(e.doing==="grab"&&this.drag(e),e.doing==="move"&&!this.two){let a=this.where(e);t.place.shift(a.clone().sub(e.last)),e.last.copy(a)}this.drawBeam(e,i?.distance);let r=e.source?.handedness,o=(r==="left"||r==="right")&&t.console?.hands.leading.has(r);e.beam.visible=e.source?.targetRayMode==="tracked-pointer"&&(!o||i!==void 0)}drag(e){let t=e.pose(),n=e.local.clone().applyMatrix4(t),i=new De().setFromRotationMatrix(t),r=new De().setFromRotationMatrix(e.first);this.app.grab.move(n,this.app.grab.turning?i.multiply(r.invert()):new De)}pair(){let{place:e}=this.app,[t,n]=this.hands.filter(i=>i.doing==="free"||i.doing==="move");if(!t||!n){if(this.two){e.endTwo();for(let i of this.hands)i.last.copy(this.where(i))}this.two=!1;return}this.two?e.moveTwo(this.where(t),this.where(n)):e.beginTwo(this.where(t),this.where(n)),this.two=!0}where(e){return e.pinch()??new S().setFromMatrixPosition(e.ray.matrixWorld)}onPanel(e){let t=this.app.xrPanel.mesh,n=new S(0,0,1).transformDirection(t.matrixWorld),i=new $t().setFromNormalAndCoplanarPoint(n,t.getWorldPosition(new S)),r=e.ray.intersectPlane(i,new S);if(!r)return null;let{width:o,height:a}=t.geometry.parameters;return t.worldToLocal(r),new ye(r.x/o+.5,r.y/a+.5)}drawBeam(e,t){let n=e.pinch();e.dot.visible=n!==null,n&&e.dot.position.copy(n);let i=t??(e.doing==="grab"&&!e.near?e.local.length():1.2);e.beam.scale.z=i,e.beam.material.opacity=t!==void 0||e.doing!=="nothing"?.9:.35}look(e){let{app:t}=this,n=this.count===0;if(this.cursor.visible=n,!n)return;t.xr.head(this.gaze);let i=this.gazeHand,r=Nc(this.gaze.matrixWorld,this.caster),o=t.xrPanel.group.visible?r.intersectObject(t.xrPanel.mesh,!1)[0]:void 0,a=o?.uv?t.xrPanel.hover(o.uv):"",l=o||t.console?null:Wo(r,t.members),c=t.place.placing&&t.place.reticle.visible&&!o,h=a||(i.doing==="grab"?"holding":c?"floor":l?`${l.member.model.info?.name}/${l.link??"handle"}`:""),u=o?.point??l?.point??r.ray.at(1.5,new S);i.doing==="grab"&&this.drag(i),this.timeLook(e,h,u),this.drawCursor(u,e,h)}timeLook(e,t,n){let i=this.dwell,r=this.gazeHand,o=n.distanceTo(i.at)>US*Math.max(1,n.distanceTo(this.app.xr.viewer()));if(t!==i.id||o){this.dwell={id:t,at:n.clone(),since:e,done:!1};return}!t||i.done||e-i.since<Dg||(i.done=!0,r.doing==="grab"?this.stop(r):(this.start(r),this.app.grab.held||this.stop(r)))}drawCursor(e,t,n){let i=this.app.xr.viewer();this.cursor.position.copy(e).addScaledVector(i.clone().sub(e).normalize(),.01),this.cursor.lookAt(i);let r=n&&!this.dwell.done?Math.min(1,(t-this.dwell.since)/Dg):0;this.cursor.scale.setScalar((1+.9*r)*Math.max(.6,e.distanceTo(i)))}};var FS=.5,kS=140,Fc=class{constructor(e,t){this.app=t;this.box.className="coach",this.box.dataset.id="coach",this.box.hidden=!0;let n=document.createElement("i");n.setAttribute("aria-hidden","true"),this.words.textContent="Drag here",this.box.append(n,this.words),e.append(this.box)}app;box=document.createElement("div");words=document.createElement("span");done=!1;x=NaN;y=NaN;refresh(){let e=this.place();if(this.box.hidden=e===null,!e||Math.hypot(e.x-this.x,e.y-this.y)<FS)return;this.x=e.x,this.y=e.y,this.box.style.left=`${e.x}px`,this.box.style.top=`${e.y}px`;let[t]=this.app.world.free();this.box.classList.toggle("left",e.x+kS>Math.min(t,window.innerWidth))}place(){let{app:e}=this;if(this.done||e.xr.presenting||e.model.line!=="open")return null;let t=e.console?this.instrument():this.ring();if(!t||this.inPicture(t))return t;if(!e.console)return null;let[n,i]=e.console.views.free,r={x:n/2,y:i/2};return this.inPicture(r)?r:null}inPicture(e){return document.elementFromPoint(e.x,e.y)===this.app.world.renderer.domElement}instrument(){let{console:e,model:t}=this.app;if(!e||!t.console)return null;e.pens.active&&(this.done=!0);let n=e.forms.due!==null||!!t.console.task?.over,i=t.console.owner!==null||e.plan.phase!=="off"||n;if(this.done||i||e.views.large!=="scope")return null;let r=e.tip("right");return r?e.views.project(r,"scope"):null}ring(){let{members:e,model:t,world:n}=this.app;t.robots.some(l=>l.holding)&&(this.done=!0);let i=e[0]?.handle.group;if(this.done||!i?.visible||t.state.playing||e.length!==1)return null;let r=i.getWorldPosition(new S).project(n.camera);if(Math.abs(r.x)>1||Math.abs(r.y)>1||r.z>1)return null;let{clientWidth:o,clientHeight:a}=n.renderer.domElement;return{x:o*(1+r.x)/2,y:a*(1-r.y)/2}}};var BS=[["One finger","the nearest instrument follows"],["Two fingers","move, zoom and roll the camera"]],zS=[["One finger","the pedal is pressed, and the instrument follows"],["Two fingers","the instrument moves; pinch for depth"]],HS=[["Drag","the nearest instrument follows"],["Drag with Shift","the instrument rotates"],["Wheel","the instrument moves away from the lens or towards it"],["Drag with the right button","the camera moves"]],GS=[["Drag","the pedal is pressed, and the instrument follows"],["Drag with Shift","the instrument rotates about the point where it enters the eye"],["Wheel","the pedal is pressed for a moment, and the instrument moves away from the lens or towards it"]];function Ng(s,e){let{enables:t}=s,n=t?"microscope":"endoscope",i=t?Em:Am;return[{head:`Mouse, in the ${n}\u2019s picture`,rows:()=>t?GS:HS},{head:"Touch",rows:()=>t?zS:BS},{head:"Keys",rows:()=>[...t?ym:xm,["Show this list","?"]]},{head:"Gamepad",rows:()=>s.pad.name?i:[["None","connect one, and press one of its buttons"]]},{head:"Headset",rows:()=>t?Kl:Yl},{head:"Other programs",rows:()=>VS(e())}]}function VS(s){let e=s?.packets?`port ${s.packets.port}`:"off, see twin serve --packets",t=s?.mqtt?`${s.mqtt.topic}/set at ${s.mqtt.broker}`:"off, see twin serve --mqtt";return[["Hands by UDP packets",e],["Motion scale by MQTT",t]]}var kc=class{constructor(e,t){this.parts=t;this.list.className="keys",this.list.setAttribute("aria-label","Mouse and keys");let n=document.createElement("button");n.className="push",n.textContent="Close",n.title="Hide this list (Escape)",n.onclick=()=>this.list.close(),this.body.tabIndex=0,this.body.className="keys-body",this.list.append(this.body,n),e.append(this.list)}parts;list=document.createElement("dialog");body=document.createElement("div");get open(){return this.list.open}toggle(){if(this.list.open){this.list.close();return}this.body.replaceChildren(...this.parts().flatMap(e=>WS(e))),this.list.showModal(),this.body.scrollTop=0}};function WS(s){let e=s.rows();if(!e.length)return[];let t=document.createElement("table");for(let[i,r]of e){let o=t.insertRow(),a=document.createElement("th");a.scope="row",a.textContent=i,o.append(a),o.insertCell().textContent=r}if(!s.head)return[t];let n=document.createElement("h2");return n.textContent=s.head,[n,t]}var XS=[["Move the tool","drag the blue ring; with Shift, the tool rotates"],["Move any link","drag it: the mechanism follows"],["Rotate the view","drag the background; one finger on a touch screen"],["Zoom","wheel, or two fingers"],["Play or pause","Space"],["Undo the last drag","Ctrl-Z"],["Show these keys","?"],["Hide them","Escape"]],Bc=class{constructor(e,t){this.app=t;let n=[{head:"",rows:()=>XS}];this.list=new kc(e,()=>t.console?Ng(t.console,()=>t.model.console):n),window.addEventListener("keydown",i=>this.press(i))}app;list;toggle(){this.list.toggle()}press(e){if(e.target instanceof HTMLSelectElement)return;if(this.app.console){e.key==="?"&&!e.repeat&&!e.ctrlKey&&!e.metaKey&&!e.altKey&&this.toggle();return}let t=e.ctrlKey||e.metaKey,n=t&&!e.shiftKey&&!e.altKey&&e.key.toLowerCase()==="z";if((t||e.altKey)&&!n||this.list.open&&e.key!=="?")return;let i=e.code==="Space"&&!(e.target instanceof HTMLButtonElement);if(!(!n&&!i&&e.key!=="?"))if(e.preventDefault(),n)this.app.ask("undo",{});else{if(e.repeat)return;i?this.play():this.toggle()}}play(){let{state:e}=this.app.model;e.duration>0&&this.app.ask("play",{on:!e.playing})}};var qS=1e-4,[$S,YS]=[.02,.1],KS={E_STOP:"is stopped (E_STOP)",INIT:"moves to its start (INIT)",PEDAL_UP:"is at rest (PEDAL_UP)",PEDAL_DN:"follows the hand (PEDAL_DN)"},zc=class{constructor(e){this.app=e;this.box.className="headline";for(let t=0;t<4;t++){let n=document.createElement("li");this.items.push(n),this.box.append(n)}}app;box=document.createElement("ul");items=[];refresh(){let e=[this.machine(),this.rcm(),this.depth(),this.limit()];this.box.hidden=this.app.console!==null,e.forEach((t,n)=>{let i=this.items[n];i.hidden=t===null,t&&(i.dataset.tone=t[0],i.textContent!==t[1]&&(i.textContent=t[1]))})}machine(){let{machine:e}=this.app.model.state;if(!e)return null;let t=e.level===null?"does not answer":KS[e.level]??e.level,n=e.behind===null?"":`, ${Wt(e.behind)} behind`,i=`Machine ${t}${n}`;return e.problem?["bad",`${i}: ${e.problem}`]:["good",i]}rcm(){let e=this.app.model.state.rcm_error_m;return e==null?null:e<=qS?["good","Shaft passes through the port (RCM)"]:["warn",`Shaft misses the port (RCM) by ${Wt(e)}`]}depth(){let e=this.app.model.state.depth_m;return e==null?null:e>0?["good",`Inserted ${Wt(e)}`]:["plain",`Not inserted, ${Wt(-e)} outside`]}limit(){let{info:e}=this.app.model,t=1/0,n="";for(let i of e?.joints.filter(r=>r.active)??[]){let{lower:r,upper:o}=i;if(r===null||o===null||r===void 0||o===void 0||!(o>r))continue;let a=this.app.model.joint(i.name),l=Math.min(a-r,o-a);l/(o-r)>=t||(t=l/(o-r),n=`Nearest limit: ${i.name}, ${Ls(Math.max(l,0),ts(i))} away`)}return n?[t<$S?"bad":t<YS?"warn":"good",n]:null}};function Ld(s){let e=s.console?.info.choice;if(!e)return[];let t=(i,r,o)=>({kind:"button",id:i===null?"start-none":`start-${i}`,label:()=>r,on:()=>e.present===i,off:()=>s.model.leaving||e.present===i,press:()=>{s.ask("task",{do:"start",name:i})},hint:o});return[...e.tasks.map(([i,r])=>t(i,`${r.charAt(0).toUpperCase()}${r.slice(1)}`,"Start this task: the page then shows its steps and its clock")),t(null,"No task","Move the instruments freely, without steps, clock and result")]}var Hc=class{constructor(e){this.app=e;this.box.className="task-list",this.box.dataset.id="tasks",this.box.hidden=!0,this.box.open=window.matchMedia("(min-width: 1101px) and (min-height: 700px)").matches;let t=document.createElement("summary");t.textContent="Start a task",this.box.append(t)}app;box=document.createElement("details");built=!1;refresh(){let e=this.app.console?.info.choice??null;this.box.hidden=e===null||e.present!==null;for(let t of this.box.querySelectorAll("button"))t.disabled=this.app.model.leaving;if(!(this.built||!e)){this.built=!0;for(let t of Ld(this.app)){if(t.id==="start-none")continue;let n=document.createElement("button");n.className="push",n.dataset.id=`top-${t.id}`,n.textContent=t.label(),n.title=t.hint,n.onclick=()=>t.press(),this.box.append(n)}}}};var Gc=class{constructor(e,t){this.app=t;this.box.className="toast",this.box.setAttribute("role","alert"),this.box.hidden=!0;let n=document.createElement("button");n.className="push",n.textContent="Reload the page",n.onclick=()=>location.reload(),this.box.append(this.text,n),e.append(this.box),setInterval(()=>this.look(),500)}app;box=document.createElement("div");text=document.createElement("p");since=NaN;look(){let e=this.app.model.line==="reconnecting"&&!this.app.model.leaving;e?Number.isNaN(this.since)&&(this.since=performance.now()):this.since=NaN;let t=e&&performance.now()-this.since>2500;if(t===!this.box.hidden)return;let n=this.app.model.scene?.name??"";this.text.textContent=`The server does not answer. If it has ended, run "twin serve ${n}" again: this page then reconnects by itself.`,this.box.hidden=!t}};var jS={connecting:"Connecting to the server",open:"Connected to the server",reconnecting:"The server does not answer",refused:"The server refuses this page"},ZS=.3,Vc=class{constructor(e,t){this.app=t;this.dot.className="dot",this.enter.className="enter",this.enter.dataset.id="enter",this.other.className="push",this.other.dataset.id="enter-vr",this.about.dataset.id="xr",this.about.className="about",this.help.className="help",this.help.textContent="Drag the blue ring: the tool follows.",this.more.className="push more",this.more.dataset.id="keys",this.more.textContent="?",this.more.title="What mouse, fingers and keys do",this.more.setAttribute("aria-label","Mouse and keys"),this.headline=new zc(t),this.keys=new Bc(e,t),this.more.onclick=()=>this.keys.toggle(),this.coach=new Fc(e,t),this.tasks=new Hc(t),new Gc(e,t);let n=document.createElement("div");n.className="title",n.append(this.dot,this.name,this.more);let i=document.createElement("div");i.className="ways",i.append(this.enter,this.other),this.bar.append(n,this.headline.box,this.tasks.box,i,this.about),e.append(this.bar,this.help);let r=()=>document.documentElement.style.setProperty("--head",`${this.bar.offsetTop+this.bar.offsetHeight}px`);new ResizeObserver(r).observe(this.bar),this.enter.title="Show the robot in the headset of this device",this.other.title="Show the robot in a virtual room instead of yours",this.enter.onclick=()=>{t.xr.enter()},this.other.onclick=()=>{t.xr.enter("immersive-vr")}}app;bar=document.createElement("header");name=document.createElement("h1");dot=document.createElement("span");enter=document.createElement("button");other=document.createElement("button");about=document.createElement("p");help=document.createElement("p");more=document.createElement("button");headline;keys;coach;tasks;covers(e){let{right:t,bottom:n}=this.bar.getBoundingClientRect();return t>ZS*e?Math.round(n):0}refresh(){let{xr:e,model:t}=this.app;this.name.textContent=t.scene?.title||t.scene?.name||"twin",this.dot.dataset.line=t.line,this.dot.title=jS[t.line],this.enter.textContent=e.ar?"Enter AR":e.vr?"Enter VR":"No headset found",this.enter.disabled=!(e.ar||e.vr)||e.presenting,this.other.textContent="Enter VR",this.other.hidden=!(e.ar&&e.vr),this.about.textContent=e.text,this.headline.refresh(),this.tasks.refresh(),this.coach.refresh(),this.app.console&&(this.help.textContent=this.app.console.help),document.documentElement.toggleAttribute("data-console",this.app.console!==null),this.help.hidden=t.status().tone!=="plain"}};var Wc=class{group=new Pe;ball=new ue(new Hn(1,24,16),At(jt,.35));ring=new ue(new gs(1.25,.09,8,40),At(jt));constructor(){this.group.add(this.ball,this.ring);for(let e of[this.ball,this.ring])e.material.depthTest=!1,e.renderOrder=4;this.group.visible=!1,this.ball.userData.twinHandle=!0}put(e,t,n){e.decompose(this.group.position,this.group.quaternion,this.group.scale),this.group.scale.setScalar(t);for(let i of[this.ball,this.ring])i.material.color.setHex(n)}};var Xc=class{constructor(e,t){this.model=t;this.overlays=new xc(e,this.place),this.place.add(this.handle.group),e.robotWorld.add(this.place)}model;robot=null;place=new Pe;overlays;handle=new Wc;get size(){return this.overlays.size}adopt(e){let{model:t}=this;if(this.robot=e,this.place.add(e.root),e.root.rotation.set(0,0,0),t.info){let{p:i,q:r}=Mn(t.info.T_world_base);this.place.position.copy(i),this.place.quaternion.copy(r),t.info.scenery&&this.overlays.setScenery(t.info.scenery)}this.follow();let n=e.box();t.info?.scenery&&(n.min.z=Math.min(n.min.z,t.info.scenery.floor)),this.overlays.setSize(n.getSize(new S).length()/1.5)}follow(){let{model:e,robot:t}=this;!t||!e.frame||!e.info||(t.apply(e.frame,e.info.links),this.overlays.update(e,t))}box(){let e=this.robot?.box()??new vt,t=this.model.info?.scenery;return t&&(e.min.z=Math.min(e.min.z,t.floor)),this.place.updateMatrix(),e.applyMatrix4(this.place.matrix)}};var qc=class{constructor(e){this.app=e;let t=e.world.renderer.domElement,n={capture:!0};t.addEventListener("pointerdown",i=>this.down(i),n),t.addEventListener("pointermove",i=>this.move(i),n),t.addEventListener("pointerup",i=>this.up(i),n),t.addEventListener("pointercancel",i=>this.up(i),n),t.addEventListener("wheel",i=>this.wheel(i),{capture:!0,passive:!1}),t.addEventListener("pointerleave",()=>this.app.grab.hover(null))}app;caster=new _s;plane=new $t;at=new ye;point=new S;turn=new De;last=new ye;moved=!1;pointer=null;update(){let{app:e}=this;if(!this.moved||e.xr.presenting||this.pointer!==null||e.console)return;this.moved=!1;let t=this.pick();e.grab.hover(t),e.world.renderer.domElement.style.cursor=t?"grab":""}pick(){let{members:e,world:t}=this.app;return this.caster.setFromCamera(this.at,t.camera),Wo(this.caster,e)}read(e){let t=this.app.world.renderer.domElement.getBoundingClientRect();this.at.set((e.clientX-t.left)/t.width*2-1,1-(e.clientY-t.top)/t.height*2)}down(e){let{app:t}=this;if(e.button!==0||this.pointer!==null||t.xr.presenting||t.console)return;this.read(e);let n=this.pick();if(!n||!t.take(n))return;let i=t.world.renderer.domElement;this.pointer=e.pointerId,i.setPointerCapture(e.pointerId),i.style.cursor="grabbing",t.world.orbit.enabled=!1,this.point.copy(n.point),this.turn.identity(),this.last.set(e.clientX,e.clientY),e.stopImmediatePropagation()}move(e){if(this.read(e),this.moved=!0,e.pointerId!==this.pointer)return;let{camera:t}=this.app.world;if(e.shiftKey){let[n,i]=[e.clientX-this.last.x,e.clientY-this.last.y],r=new S(0,1,0).applyQuaternion(t.quaternion),o=new S(1,0,0).applyQuaternion(t.quaternion);this.turn.premultiply(new De().setFromAxisAngle(r,n*.008)),this.turn.premultiply(new De().setFromAxisAngle(o,i*.008))}else{let n=t.getWorldDirection(new S);this.plane.setFromNormalAndCoplanarPoint(n,this.point),this.caster.setFromCamera(this.at,t),this.caster.ray.intersectPlane(this.plane,this.point)}this.last.set(e.clientX,e.clientY),this.app.grab.move(this.point,this.turn)}wheel(e){if(this.pointer===null)return;let{camera:t}=this.app.world,n=this.point.clone().sub(t.position);this.point.addScaledVector(n,-Math.sign(e.deltaY)*.01),this.app.grab.move(this.point,this.turn),e.preventDefault(),e.stopImmediatePropagation()}up(e){e.pointerId===this.pointer&&(this.pointer=null,this.app.world.renderer.domElement.style.cursor="",this.app.world.orbit.enabled=!0,this.app.grab.end())}};var Et=(s,e="",t="")=>{let n=document.createElement(s);return e&&(n.className=e),t&&(n.textContent=t),n},$c=class{side=Et("section","side");foot=Et("section","foot");updates=[];lost=()=>!1;open="simulation";folded=!1;folds=!1;shown=!1;fold=Et("button","tab fold");small=window.matchMedia("(max-width: 760px), (max-height: 480px)");narrow=window.matchMedia("(max-width: 1400px)");bodies=new Map;heads=new Map;constructor(e){this.side.setAttribute("aria-label","Controls"),e.append(this.side,this.foot);let t=()=>document.documentElement.style.setProperty("--foot",`${this.foot.offsetHeight}px`);new ResizeObserver(t).observe(this.foot);for(let n of[this.small,this.narrow])n.addEventListener("change",()=>{this.folded=this.first(),this.choose(this.open)});this.fold.dataset.id="fold",this.fold.onclick=()=>{this.folded=!this.folded,this.choose(this.open)}}show(e){this.updates=[];let t=this.heads.has("console");this.folds=e.folds??!1,this.lost=e.lost,this.side.replaceChildren(),this.bodies.clear(),this.heads.clear(),this.foot.replaceChildren();let n=Et("div","tabs"),i=Et("div","tab-list");i.setAttribute("role","tablist"),n.append(i),this.side.append(n);for(let r of e.tabs){let o=Et("button","tab",r.label);o.setAttribute("role","tab"),o.dataset.id=`tab-${r.id}`,o.title=r.hint,o.onclick=()=>{this.folded=this.small.matches&&r.id===this.open&&!this.folded,this.choose(r.id)},i.append(o),this.heads.set(r.id,o);let a=Et("div","body");a.tabIndex=0,a.setAttribute("role","tabpanel"),a.setAttribute("aria-label",r.label),a.append(...this.drawAll(r)),this.bodies.set(r.id,a),this.side.append(a)}n.append(this.fold),(!this.shown||this.heads.has("console")&&!t)&&(this.folded=this.first()),this.shown=!0,this.foot.append(this.draw(e.status),...e.transport.map(r=>this.draw(r))),this.choose(this.bodies.has(this.open)?this.open:e.tabs[0]?.id??""),this.refresh()}refresh(){for(let e of this.updates)e()}covers(){let[e,t]=[window.innerWidth,window.innerHeight],i=("halves"in document.documentElement.dataset?2:1)*this.side.getBoundingClientRect().left,r=i>e/2;return[r&&!this.folded?e-i:0,t-(r?this.foot:this.side).getBoundingClientRect().top]}get left(){let{left:e,top:t}=this.side.getBoundingClientRect();return t<window.innerHeight/4?e:window.innerWidth}first(){return this.small.matches||this.heads.has("console")&&this.folds&&this.narrow.matches}choose(e){this.open=e,this.fold.textContent=this.folded?"\u25BE":"\u25B4",this.fold.title=this.folded?"Show the controls":"Hide the controls",this.fold.setAttribute("aria-label",this.fold.title),this.fold.setAttribute("aria-expanded",String(!this.folded));for(let[t,n]of this.bodies)n.hidden=this.folded||t!==e;for(let[t,n]of this.heads)n.setAttribute("aria-selected",String(!this.folded&&t===e))}drawAll(e){return e.controls.map(t=>this.draw(t))}draw(e){switch(e.kind){case"head":{let t=Et("h2","",e.text);return this.showIf(t,e.shown),t}case"text":{let t=Et("p","text");return t.dataset.id=e.id,e.id==="status"&&t.setAttribute("role","status"),this.on(()=>`${e.tone?.()??"plain"}|${e.text()}`,()=>{t.textContent=e.text(),t.dataset.tone=e.tone?.()??"plain",t.hidden=!e.text()}),t}case"button":return this.button(e);case"row":{let t=Et("div","row");return t.append(...e.items.map(n=>this.button(n))),this.showIf(t,e.shown),t}case"choice":return this.choice(e);case"slider":return this.slider(e)}}showIf(e,t){t&&this.on(()=>String(t()),()=>e.hidden=!t())}button(e){let t=Et("button","push");t.dataset.id=e.id,t.title=e.hint;let{lost:n}=this;return t.onclick=()=>e.press(),this.on(()=>`${e.label()}|${e.on?.()??""}|${e.off?.()??""}|${n()}`,()=>{t.textContent=e.label(),t.disabled=n()||(e.off?.()??!1),e.on&&t.setAttribute("aria-pressed",String(e.on()))}),t}choice(e){let t=Et("label","field",e.label);t.title=e.hint;let{lost:n}=this,i=Et("select");return i.dataset.id=e.id,t.append(i),i.onchange=()=>e.set(i.value),this.on(()=>JSON.stringify([e.options(),e.get(),n()]),()=>{i.replaceChildren(...e.options().map(([r,o])=>{let a=Et("option","",o);return a.value=r,a})),i.value=e.get(),i.disabled=n()}),t}slider(e){let t=Et("div","slider"),n=Et("label","field");n.title=e.hint;let{lost:i}=this,r=Et("span","name",e.label),o=Et("output","value"),a=Et("input");a.type="range",a.step="any",a.dataset.id=e.id,a.setAttribute("aria-label",e.label),n.append(r,o,a),t.append(n);let l=!1,c=()=>{l||e.begin?.(),l=!0},h=()=>{l&&e.end?.(),l=!1};return a.onpointerdown=c,a.oninput=()=>{let u=!l;c(),e.set(a.valueAsNumber),u&&h()},a.onpointerup=a.onpointercancel=a.onlostpointercapture=h,e.segments&&t.prepend(this.segments(e)),this.on(()=>`${e.range().join()}|${e.get()}|${e.off?.()??""}|${i()}`,()=>{let[u,d]=e.range();a.min=String(u),a.max=String(d),l||(a.value=String(e.get())),a.disabled=i()||(e.off?.()??!1),o.textContent=e.show(e.get()),a.setAttribute("aria-valuetext",e.show(e.get()))}),t}segments(e){let t=Et("div","phases");return this.on(()=>JSON.stringify(e.segments?.()),()=>{let[n,i]=e.range();t.replaceChildren(...(e.segments?.()??[]).map(([r,o,a])=>{let l=Et("button","phase",r);return l.title=`${r}: ${o.toFixed(2)}\u2013${a.toFixed(2)} s`,l.style.left=`${100*(o-n)/(i-n)}%`,l.style.width=`${100*(a-o)/(i-n)}%`,l.onclick=()=>e.set(o),l.dataset.start=String(o),l}))}),this.on(()=>String(e.get()),()=>{let n=e.get(),i=[...t.children],r=e.segments?.()??[];i.forEach((o,a)=>o.toggleAttribute("data-now",n>=(r[a]?.[1]??0)&&n<(r[a]?.[2]??0)))}),t}on(e,t){let n=null;this.updates.push(()=>{let i=e();i!==n&&(n=i,t())})}};var Og={paper:"#f7f9fcf2",edge:"#b9c4d1",ink:"#17212e",faint:"#55616f",button:"#e3e9f1",hot:"#c9dbf3",on:"#2268c9",onInk:"#ffffff",good:"#0c7a43",warn:"#9a5200",bad:"#b3101e"},JS={paper:"#eaf3ff",edge:"#ffffff",ink:"#2a5db0",faint:"#4d7cc4",button:"#cfe3ff",hot:"#ffffff",on:"#3f8cff",onInk:"#ffffff",good:"#12a35c",warn:"#c97400",bad:"#e0283a"};function Ug(s){return s==="additive"?JS:Og}var Yc=class{constructor(e){this.canvas=e;this.c=e.getContext("2d")}canvas;c;colors=Og;begin(e){let{c:t,canvas:n}=this;this.colors=e,t.clearRect(0,0,n.width,n.height),t.fillStyle=e.paper,t.strokeStyle=e.edge,t.lineWidth=3,this.round({x:2,y:2,w:n.width-4,h:n.height-4},28),t.fill(),t.stroke()}clip(e,t,n,i){this.c.save(),this.c.beginPath(),this.c.rect(e,t,n,i),this.c.clip()}unclip(){this.c.restore()}rule(e){this.c.fillStyle=this.colors.edge,this.c.fillRect(24,e,this.canvas.width-48,2)}text(e,t,n,i,r,o,a,l=!1){let{c,colors:h}=this;c.font=`${l?600:400} ${o}px system-ui, sans-serif`,c.fillStyle=r==="plain"?h.ink:h[r],c.textAlign="left",c.textBaseline="top";let u=e.split(`
`).flatMap(f=>this.wrap(f,i)),d=u.slice(0,a);return d.length<u.length&&(d[a-1]=`${d[a-1]} \u2026`),d.forEach((f,g)=>c.fillText(f,t,n+g*o*1.3)),n+d.length*o*1.3}right(e,t,n,i){let{c:r,colors:o}=this;r.font=`600 ${i}px system-ui, sans-serif`,r.fillStyle=o.ink,r.textAlign="right",r.textBaseline="top",r.fillText(e,t,n),r.textAlign="left"}button(e,t,n,i,r){let{c:o,colors:a}=this;o.fillStyle=n?a.on:r&&!i?a.hot:a.button,o.globalAlpha=i?.45:1,this.round(e,14),o.fill(),r&&!i&&(o.strokeStyle=a.on,o.lineWidth=4,o.stroke()),o.fillStyle=n?a.onInk:a.ink,this.middle(t,e),o.globalAlpha=1}field(e,t){let{c:n,colors:i}=this;n.strokeStyle=i.edge,n.lineWidth=2,this.round(e,14),n.stroke(),n.fillStyle=i.ink,this.middle(t,e)}bar(e,t,n,i){let{c:r,colors:o}=this,a=e.y+e.h/2,l=e.x+14,c=l+t*(e.w-28);r.globalAlpha=n?.45:1,r.fillStyle=o.button,this.round({x:l,y:a-6,w:e.w-28,h:12},6),r.fill(),r.fillStyle=o.on,this.round({x:l,y:a-6,w:Math.max(12,c-l),h:12},6),r.fill(),r.beginPath(),r.arc(c,a,i?20:16,0,2*Math.PI),r.fill(),r.globalAlpha=1}segments(e,t,n,i,r,o){let{c:a,colors:l}=this;for(let[c,h,u]of r){let d={x:e+h*n+1,y:t,w:(u-h)*n-2,h:i},f=o>=h&&o<u;a.fillStyle=f?l.on:l.button,this.round(d,6),a.fill(),a.fillStyle=f?l.onInk:l.faint,a.font="400 22px system-ui, sans-serif",d.w>40&&this.middle(this.fit(c,d.w-10),d,!0)}}middle(e,t,n=!1){let{c:i}=this;n||(i.font="500 28px system-ui, sans-serif",i.measureText(e).width>t.w-12&&(i.font="500 22px system-ui, sans-serif")),i.textAlign="center",i.textBaseline="middle",i.fillText(this.fit(e,t.w-8),t.x+t.w/2,t.y+t.h/2+1),i.textAlign="left"}fit(e,t){let{c:n}=this;if(n.measureText(e).width<=t)return e;let i=e.length;for(;i>1&&n.measureText(`${e.slice(0,i)}\u2026`).width>t;)i--;return`${e.slice(0,i)}\u2026`}wrap(e,t){let n=[],i="";for(let r of e.split(" ")){let o=i?`${i} ${r}`:r;i&&this.c.measureText(o).width>t?(n.push(i),i=r):i=o}return[...n,i]}round(e,t){this.c.beginPath(),this.c.roundRect(e.x,e.y,Math.max(e.w,1),e.h,Math.min(t,Math.max(e.w,1)/2,e.h/2))}};var Ii=1024,Os=1e3,Kc=.48,ai=24,Fg=210,QS=90,jc=class{group=new Pe;mesh;look="normal";canvas=document.createElement("canvas");texture;pen;sheet=null;open="simulation";zones=[];hot="";held=null;scroll=0;deepest=0;foot=Fg;drawn=0;stale=!0;constructor(){this.canvas.width=Ii,this.canvas.height=Os,this.pen=new Yc(this.canvas),this.texture=new bi(this.canvas),this.texture.colorSpace=ot,this.texture.generateMipmaps=!1,this.texture.minFilter=St;let e=new lt({map:this.texture,transparent:!0,toneMapped:!1});this.mesh=new ue(new Vt(Kc,Kc*Os/Ii),e),this.mesh.userData.twinPanel=!0,this.mesh.renderOrder=8,this.group.add(this.mesh),this.group.visible=!1}show(e){this.sheet=e,e.tabs.some(t=>t.id===this.open)||(this.open=e.tabs[0]?.id??""),this.stale=!0}refresh(){this.stale=!0}placeBefore(e,t,n=.36){let i=t.clone().setY(0);i.lengthSq()<1e-6&&i.set(0,0,-1),i.normalize();let r=new S(i.z,0,-i.x);this.group.position.copy(e).addScaledVector(i,.72).addScaledVector(r,n).add(new S(0,-.14,0)),this.group.lookAt(e)}outOfSight(e,t){let n=this.group.position.clone().sub(e);return n.length()>2.2||n.normalize().dot(t)<.2}hover(e){let t=e?this.zoneAt(e)?.id??"":"";return t!==this.hot&&(this.hot=t,this.stale=!0),t}press(e){let t=this.zoneAt(e);return t?(t.slider?(this.held=t.slider,t.slider.begin?.(),this.slide(t,e)):t.press?.(),this.stale=!0,!0):!1}drag(e){let t=this.zones.find(n=>n.slider===this.held);this.held&&t&&this.slide(t,e)}release(){this.held?.end?.(),this.held=null,this.stale=!0}whereIs(e){let t=this.zones.find(n=>n.id===e);return t?new ye((t.x+t.w/2)/Ii,1-(t.y+t.h/2)/Os):null}pointAt(e){let t=new S((e.x-.5)*Kc,(e.y-.5)*Kc*Os/Ii,0);return this.mesh.localToWorld(t)}update(e){return!this.group.visible||!this.stale||e-this.drawn<QS||!this.sheet?!1:(this.drawn=e,this.stale=!1,this.draw(this.sheet),this.texture.needsUpdate=!0,!0)}get object(){return this.mesh}zoneAt(e){let[t,n]=[e.x*Ii,(1-e.y)*Os];return this.zones.find(i=>t>=i.x&&t<=i.x+i.w&&n>=i.y&&n<=i.y+i.h)}slide(e,t){let n=e.slider;if(!n||n.off?.())return;let[i,r]=n.range(),o=Math.min(1,Math.max(0,(t.x*Ii-e.x-14)/(e.w-28)));n.set(i+o*(r-i)),this.stale=!0}draw(e){let t=this.pen;t.begin(Ug(this.look)),this.zones=[];let n=Ii-2*ai,i=e.tabs.length,r=(n-8*(i-1))/i;e.tabs.forEach((d,f)=>{let g=ai+f*(r+8),y={id:`tab-${d.id}`,x:g,y:ai,w:r,h:62,press:()=>this.choose(d.id)};t.button(y,d.label,d.id===this.open,!1,this.hot===y.id),this.zones.push(y)});let o=e.status;t.text(o.text(),ai,ai+78,n,o.tone?.()??"plain",30,2);let a=ai+168,l=Os-ai-this.foot;t.rule(a-10);let c=e.tabs.find(d=>d.id===this.open);t.clip(0,a,Ii,l-a);let h=a+6-this.scroll;for(let d of c?.controls??[])h=this.control(d,ai,h,n-70,a,l);t.unclip(),this.deepest=Math.max(0,h+this.scroll-l),this.scrollers(a,l),t.rule(l+8),h=l+18;for(let d of e.transport)h=this.control(d,ai,h,n,0,Os);let u=Math.max(Fg,h-l);u!==this.foot&&(this.foot=u,this.stale=!0)}choose(e){this.open=e,this.scroll=0,this.stale=!0}scrollers(e,t){if(this.scroll=Math.min(this.scroll,this.deepest),this.deepest<=0)return;let n=.7*(t-e),i=Ii-ai-56,r={id:"scroll-up",x:i,y:e,w:56,h:120,press:()=>this.scroll=Math.max(0,this.scroll-n)},o={id:"scroll-down",x:i,y:t-120,w:56,h:120,press:()=>this.scroll=Math.min(this.deepest,this.scroll+n)};this.pen.button(r,"\u25B2",!1,this.scroll<=0,this.hot===r.id),this.pen.button(o,"\u25BC",!1,this.scroll>=this.deepest,this.hot===o.id),this.zones.unshift(r,o)}control(e,t,n,i,r,o){let a=this.pen,l=c=>(c.y+c.h/2>=r&&c.y+c.h/2<=o&&this.zones.push(c),c);switch(e.kind){case"head":return e.shown?.()===!1?n:a.text(e.text,t,n+10,i,"plain",30,1,!0)+6;case"text":return e.text()?a.text(e.text(),t,n,i,e.tone?.()??"plain",27,400)+12:n;case"button":return this.row([e],t,n,i,l);case"row":return e.shown?.()===!1?n:this.row(e.items,t,n,i,l);case"choice":return this.choice(e,t,n,i,l);case"slider":return this.slider(e,t,n,i,l)}}row(e,t,n,i,r){let o=e.length>3&&i<950?3:e.length,a=(i-8*(o-1))/o;return e.forEach((l,c)=>{let h={id:l.id,x:t+c%o*(a+8),y:n+Math.floor(c/o)*68,w:a,h:60},u=l.off?.()??!1;r(u?h:{...h,press:l.press}),this.pen.button(h,l.label(),l.on?.()??!1,u,this.hot===l.id)}),n+Math.ceil(e.length/o)*68+8}choice(e,t,n,i,r){let o=e.options(),a=Math.max(0,o.findIndex(([u])=>u===e.get())),l=u=>()=>e.set(o[(a+u+o.length)%o.length]?.[0]??"");this.pen.text(e.label,t,n,i,"faint",25,1);let c=r({id:`${e.id}-previous`,x:t,y:n+34,w:72,h:60,press:l(-1)}),h=r({id:`${e.id}-next`,x:t+i-72,y:n+34,w:72,h:60,press:l(1)});return this.pen.button(c,"\u2039",!1,o.length<2,this.hot===c.id),this.pen.button(h,"\u203A",!1,o.length<2,this.hot===h.id),this.pen.field({x:t+80,y:n+34,w:i-160,h:60},o[a]?.[1]??"\u2013"),n+108}slider(e,t,n,i,r){let[o,a]=e.range(),l=g=>Math.min(1,Math.max(0,(g-o)/Math.max(a-o,1e-9))),c=e.get(),h=n,u=(e.segments?.()??[]).map(([g,y,p])=>[g,l(y),l(p)]);u.length?(this.pen.segments(t+14,n,i-28,34,u,l(c)),h+=38):this.pen.text(e.label,t,n,i/2,"plain",27,1);let d=e.off?.()??!1;u.length||(this.pen.right(e.show(c),t+i,n,27),h+=34);let f={id:e.id,x:t,y:h,w:i,h:52};return r(d?f:{...f,slider:e}),this.pen.bar(f,l(c),d,this.hot===e.id||this.held===e),u.length&&this.pen.right(e.show(c),t+i,h+46,25),h+60}};var eT=.004,tT=2.5,Zc=class{group=new Pe;nodes=[];labels=new Map;labelled=!0;numbered=[];shown;async load(e){if(!e)return;let t=ns((await oi(e.file)).scene);this.nodes=e.names.map(n=>t.find(i=>i.name===n));for(let n of this.nodes)n&&(n.traverse(i=>{i instanceof ue&&(i.castShadow=i.receiveShadow=!0)}),this.group.add(n));this.number(this.numbered)}update(e){return!e||No(e.body,this.shown)?!1:(this.shown=e.body,this.nodes.forEach((t,n)=>{t?.position.fromArray(e.poses,7*n),t?.quaternion.fromArray(e.poses,7*n+3)}),!0)}show(e){this.labelled=e;for(let{sprite:t}of this.labels.values())t.visible=e}number(e){this.numbered=e;for(let t of this.nodes)t&&e.includes(t.name)&&!this.labels.has(t)&&this.add(t)}add(e){let t=/\d+$/.exec(e.name)?.[0];if(!t)return;let n=new sn;n.say(t,"#17212e","normal",eT),n.sprite.name=`number ${t}`,n.sprite.center.set(.5,tT),n.sprite.layers.set(Ns),n.sprite.visible=this.labelled,e.add(n.sprite),this.labels.set(e,n)}at(e){return this.nodes.find(t=>t?.name===e)?.position.toArray()??[]}};var kg=.1,Bg=10,Jc=class{constructor(e){this.world=e;let t=new ue(new qi(.085,.1,48).rotateX(-Math.PI/2),Ci(At(jt))),n=new ue(new qi(0,.012,24).rotateX(-Math.PI/2),Ci(At(jt)));this.reticle.add(t,n),this.reticle.visible=!1,this.reticle.matrixAutoUpdate=!1,e.scene.add(this.reticle)}world;placing=!1;moving=!1;reticle=new Pe;onChange=()=>{};ground=0;two=null;get node(){return this.world.placement}get scale(){return this.node.scale.x}get yaw(){return this.node.rotation.y}get height(){return this.node.position.y-this.ground}setScale(e){this.node.scale.setScalar(Math.min(Bg,Math.max(kg,e))),this.changed()}setYaw(e){this.node.rotation.set(0,Math.atan2(Math.sin(e),Math.cos(e)),0),this.changed()}setHeight(e){this.node.position.y=this.ground+e,this.changed()}reset(){this.node.scale.setScalar(1),this.node.rotation.set(0,0,0),this.world.renderer.xr.isPresenting||(this.ground=0,this.node.position.set(0,0,0)),this.changed()}putAt(e,t){this.ground=e.y,this.node.position.copy(e),this.face(t),this.placing=!1,this.reticle.visible=!1,this.changed()}before(e,t,n){let i=t.clone().setY(0);i.lengthSq()<1e-6&&i.set(0,0,-1);let r=this.world.size*this.scale;this.ground=n,this.node.position.copy(e).addScaledVector(i.normalize(),Math.max(.6,.75+.7*r)).setY(n),r<1&&(this.node.position.y=n+Math.max(0,Math.min(.75,e.y-n-.35-.6*r))),this.face(e),this.changed()}begin(){this.placing=!0,this.changed()}aim(e){this.reticle.visible=this.placing&&e!==null,e&&this.reticle.matrix.copy(e),this.reticle.matrixWorldNeedsUpdate=!0}beginTwo(e,t){this.two={mid:e.clone().add(t).multiplyScalar(.5),apart:Math.max(.02,e.distanceTo(t)),angle:Math.atan2(t.x-e.x,t.z-e.z),scale:this.scale,yaw:this.yaw,position:this.node.position.clone()}}moveTwo(e,t){let n=this.two;if(!n)return;let i=Math.min(Bg,Math.max(kg,n.scale*e.distanceTo(t)/n.apart)),r=Math.atan2(t.x-e.x,t.z-e.z)-n.angle,o=e.clone().add(t).multiplyScalar(.5),a=n.position.clone().sub(n.mid).multiplyScalar(i/n.scale);a.applyQuaternion(new De().setFromAxisAngle(nT,r)),this.node.position.copy(o).add(a),this.node.scale.setScalar(i),this.setYaw(n.yaw+r)}endTwo(){this.two=null}shift(e){this.node.position.add(e),this.changed()}face(e){let t=e.clone().sub(this.node.position);this.node.rotation.set(0,Math.atan2(t.x,t.z)-Math.atan2(gc.x,gc.z),0)}changed(){this.node.updateMatrixWorld(!0),this.world.relight(),this.onChange()}},nT=new S(0,1,0);var[Xo,qo]=[184,84],iT=.001,sT=.4,rT=Math.PI/180,oT={teleoperate:"The hand moves machine and model.",rehearse:"The hand moves the model; the machine is at rest.",judged:"The recorded motion has passed its check: run it on the machine.",replay:"The machine and the model repeat the recorded motion.",done:"The machine has repeated the recorded motion.",stopped:"Stopped.",follow:"Solid: the machine\u2019s measured joints. Ghost: its desired joints."},zg=[["teleoperate","Engage","The hand moves the machine and its model"],["rehearse","Rehearse","Disengage the machine: the hand moves only the model, and the motion is recorded"],["judge","Judge","End the rehearsal, and check speed and reach of the recorded motion"],["replay","Run","Engage the machine: it repeats the recorded motion; speed and deviation are checked"]],li=(s,e="",t="")=>{let n=document.createElement(s);return e&&(n.dataset.id=e),t&&(n.textContent=t),n},Qc=class{constructor(e,t,n){this.app=t;this.info=n;this.names=Object.keys(n.models),this.board.className="score machines",this.board.setAttribute("aria-label","Machine and model"),this.curve.width=2*Xo,this.curve.height=2*qo,this.curve.setAttribute("role","img"),this.curve.setAttribute("aria-label","Distance of the tips of machine and model over time"),n.trains&&(this.view.title="Tap the camera pedal to swap machine and model: one is drawn solid, the other as a ghost"),this.board.append(this.title,this.level,this.view,this.curve,this.apart,this.off,this.said),n.trains&&this.board.append(this.row()),e.append(this.board)}app;info;board=li("section","machines");title=li("h2","","Machine and model");level=li("p","machine-level");view=li("p","machine-view");said=li("p","machine-said");curve=li("canvas","deviation-curve");apart=li("p","deviation-text");off=li("p","deviation-joints");buttons=new Map;names;points=[];state=null;dressed="";around="";drawn=-1;row(){let e=li("div");e.className="row";for(let[t,n,i]of zg)e.append(this.button(t,n,i,()=>this.ask(t)));return e.append(this.button("machine-start","Start","Press the start button of the machine: it moves to home",()=>this.app.ask("button",{button:"start"})),this.button("machine-stop","Stop","Press the stop button of the machine",()=>this.app.ask("button",{button:"stop"}))),e}ask(e){e==="replay"&&this.app.console?.pens.use(),this.app.ask("training",{mode:e})}button(e,t,n,i){let r=li("button",e,t);return r.title=n,r.onclick=i,this.buttons.set(e,r),r}hear(e){if(e.type==="state"&&e.machines&&(this.state=e.machines,Object.values(e.machines.robots).some(r=>r.phase==="replay")&&this.app.console?.pens.use()),e.type!=="deviations")return;for(this.points.push({t:e.time,tips:this.names.map(r=>e.robots[r]?.tip??0)});this.points.length&&this.points[0].t<e.time-12;)this.points.shift();let{limit:t}=this.info,n=this.names.map(r=>`${(1e3*(e.robots[r]?.tip??0)).toFixed(2)} mm`).join(", ");this.apart.textContent=`Deviation of the tips: ${n} (last 12 s${t?`; red: force cue above ${(1e3*t).toFixed(0)} mm`:""})`;let i=this.names.map(r=>`${r}: ${this.largest(r,e.robots[r]?.joints??[])}`);this.off.textContent=["Largest joint differences:",...i].join(`
`)}largest(e,t){let n=this.info.joints[e]??[],[i,r,o]=["",-1,""];return n.forEach(([a,l],c)=>{let h=t[c]??0,u=l?Math.abs(h)/rT:Math.abs(h)*1e3;u>r&&([i,r,o]=[a,u,`${u.toFixed(2)}${l?"\xB0":" mm"}`])}),`${i} ${o}`}refresh(){let{state:e}=this;if(!e)return this.place();this.board.dataset.view=e.view,this.dress(e.view);let t=this.names.map(r=>[r,e.robots[r]]);this.level.textContent=t.map(([r,o])=>`${r}: ${o?.level??"does not answer"}`).join(`
`),this.info.trains&&(this.view.textContent=`View: ${e.view==="real"?"machine solid, model ghost":"model solid, machine ghost"} (tap the camera pedal)`);let n=t[0]?.[1],i=t.map(([,r])=>r?.problem??r?.why??"").find(r=>r)??"";this.said.textContent=i||(n?oT[n.phase]:""),this.said.dataset.tone=i?"bad":"";for(let[r]of zg){let o=this.buttons.get(r);o&&o.setAttribute("aria-pressed",String(e.mode===r))}this.place(),this.draw()}dress(e){let t=this.app.members.filter(i=>i.robot).length,n=`${e} ${t}`;if(n!==this.dressed){this.dressed=n;for(let[i,r]of Object.entries(this.info.models))for(let{model:o,robot:a}of this.app.members)(o.info?.name===i||o.info?.name===r)&&a?.veil(o.info.name===r==(e==="real"));this.app.world.dirty=!0}}covers(){let{right:e}=this.board.getBoundingClientRect();return e<window.innerWidth/2?e:0}place(){let e=document.querySelector("header")?.getBoundingClientRect().bottom??0,t=Math.round(e)+10,n=(this.app.console?.views.corner.top??window.innerHeight)-t-10,i=this.covers()?n:Math.round(sT*n),r=`${t} ${i} ${window.innerWidth} ${this.level.textContent} ${this.view.textContent} ${this.said.textContent}`,o=()=>this.board.scrollHeight-this.board.clientHeight;if(r===this.around&&o()<=0)return;this.around=r,Object.assign(this.board.style,{top:`${t}px`,maxHeight:`${i}px`});let a=[this.off,this.apart,this.curve,this.title,this.view];for(let l of a)l.hidden=!1;this.said.style.maxHeight="";for(let l of a)l.hidden=o()>0;o()>0&&(this.said.style.maxHeight=`${Math.max(0,this.said.clientHeight-o())}px`)}draw(){let e=this.points.at(-1);if(!e||e.t===this.drawn)return;this.drawn=e.t;let t=this.curve.getContext("2d"),{limit:n}=this.info,i=1.15*Math.max(iT,n??0,...this.points.flatMap(a=>a.tips)),[r,o]=[a=>(1-(e.t-a)/12)*Xo,a=>qo-1-a/i*(qo-2)];t.setTransform(2,0,0,2,0,0),t.clearRect(0,0,Xo,qo),t.lineWidth=1,t.strokeStyle="#5a6b80",t.strokeRect(.5,.5,Xo-1,qo-1),n&&(t.setLineDash([4,3]),t.strokeStyle="#d62f2f",t.beginPath(),t.moveTo(0,o(n)),t.lineTo(Xo,o(n)),t.stroke(),t.setLineDash([])),t.fillStyle=n?"#d62f2f":"#5a6b80",t.font="10px sans-serif",t.fillText(`${Number((1e3*(n??i)).toPrecision(2))} mm`,4,n?o(n)+11:11),t.lineWidth=1.6,this.names.forEach((a,l)=>{t.strokeStyle=["#0a66c2","#c7741b"][l%2],t.beginPath();for(let c of this.points)t.lineTo(r(c.t),o(c.tips[l]??0));t.stroke()})}};var aT=[["one","One picture"],["side","Stereo: side by side"],["halves","Stereo: halves of the window"],["red-cyan","Stereo: red and cyan"],["rows","Stereo: rows (polarised monitor)"]];function Hg(s){let e=(i,r,o)=>({kind:"button",id:i,label:()=>r,on:()=>s.pens[i],off:()=>s.plan.phase!=="off",press:()=>s.toggle(i),hint:o}),t=i=>({kind:"button",id:`jaw-${i}`,label:()=>s.jawLabel(i),on:()=>s.pens[i].grip>0,off:()=>!s.info.jaws[i],press:()=>s.toggleJaw(i),hint:s.info.jaws[i]?"Open or close the jaws, or switch the energy of a tool on and off":"The instrument of this hand has no jaw that moves"}),n="While the pedal is pressed, the robot follows the hand; otherwise, only the hand moves";return s.enables?{kind:"row",items:[e("clutch","Pedal",n)]}:{kind:"row",items:[e("clutch","Clutch","While the clutch pedal is pressed, the hands move freely and the instruments are at rest"),e("camera","Camera","While the camera pedal is pressed, the hands move the camera"),{kind:"button",id:"plan",label:()=>"Plan",on:()=>s.plan.phase!=="off",off:()=>s.plan.phase!=="off",press:()=>s.plan.aim(),hint:"Move a target, which may pass through anything, and plan a motion of the arm to it (hold P)"},t("left"),t("right")]}}async function lT(){try{document.fullscreenElement?await document.exitFullscreen():await document.documentElement.requestFullscreen()}catch{}}function Gg(s,e){let t=(c,h,u=()=>!0)=>({kind:"text",id:c,text:()=>u()?h.map(([d,f])=>`${d}: ${f}`).join(`
`):""}),n=()=>!s.xr.presenting,{views:i,enables:r}=e,o=r?Kl:Yl,a=i.twoLenses?[{kind:"choice",id:"stereo",label:"Endoscope\u2019s picture on this screen",hint:"Show one picture, or one for each eye",options:()=>[...aT],get:()=>i.mode,set:c=>i.setMode(c)},{kind:"row",items:[{kind:"button",id:"whole-screen",label:()=>"Full screen",on:()=>document.fullscreenElement!==null,press:()=>{lT()},hint:"Full screen at 100 % zoom: the upper row of the picture is then the upper row of the monitor"},{kind:"button",id:"swap-rows",label:()=>i.swapped?"Odd rows: left eye":"Even rows: left eye",on:()=>i.swapped,off:()=>i.mode!=="rows",press:()=>i.swapRows(),hint:"Exchange the rows of both eyes, for monitors whose upper row is polarised for the right eye"}]}]:[];return{id:"console",label:"Console",hint:"Hands, motion scale, tools and tasks",controls:[t("tracked",o,()=>s.xr.presenting),{kind:"head",text:"Hands"},...e.sides.toReversed().map(c=>({kind:"text",id:`hand-${c}`,text:()=>e.handText(c),tone:()=>{let h=s.model.console?.hands[c];return h?.wall?"warn":h?.follows?"good":"faint"}})),{kind:"row",items:[{kind:"button",id:"haptics",label:()=>"Forces",on:()=>e.haptics,press:()=>e.toggleHaptics(),hint:"Show contact forces by arrows, vibrations and forces of haptic pens"},{kind:"button",id:"swap",label:()=>"Swap the pictures",hint:"Enlarge the small picture (V)",press:()=>i.swap()},{kind:"button",id:"let-go",label:()=>"Release the hands",hint:"Let other people or programs move the instruments",off:()=>!e.pens.active,press:()=>e.pens.drop()}]},{kind:"slider",id:"motion-scale",label:"Motion scale",hint:"How far an instrument moves for a motion of the hand: 0.5 is half as far (\u2013 and +)",range:()=>[e.info.scale[0]??.05,e.info.scale[1]??1],get:()=>e.scale,set:c=>e.setScale(c),show:c=>c.toFixed(2)},...cT(s,e),{kind:"text",id:"forces",text:()=>e.forces.text()},...a,{kind:"text",id:"rate",tone:()=>"faint",text:()=>uT(s.model.console)},{kind:"text",id:"packets",text:()=>dT(s.model.console)},{kind:"text",id:"mqtt",text:()=>fT(s.model.console?.mqtt??null),tone:()=>s.model.console?.mqtt?.problem?"warn":"plain"},{kind:"text",id:"pad",tone:()=>"faint",text:()=>e.pad.name?`Gamepad: ${e.pad.name}`:""},...hT(s),{kind:"text",id:"more",tone:()=>"faint",text:()=>n()?"Mouse, touch, keys, gamepad, headset, other programs: behind ?":""}]}}function cT(s,e){let{info:t}=e,i=(t.tools.length?Qe.toReversed():[]).map(o=>({kind:"choice",id:`tool-${o}`,label:`Tool of the ${o} hand`,hint:`Choose what the ${o} hand holds`,options:()=>t.tools.map(a=>[a.name,a.title]),get:()=>s.model.console?.hands[o]?.tool??"",set:a=>e.takeTool(o,a)}));if(!t.fulcrum)return i;let r={kind:"button",id:"fulcrum",label:()=>e.fulcrumText(),on:()=>s.model.console?.fulcrum==="direct",press:()=>e.toggleFulcrum(),hint:"Choose whether the hands move the tips or the outer ends of the instruments, which pivot in their ports"};return[...i,{kind:"row",items:[r]}]}function hT(s){let e=Ld(s);if(!e.length)return[];let t=()=>s.xr.presenting||s.console?.info.choice?.present!==null;return[{kind:"head",text:"Tasks",shown:t},...e.map(n=>({kind:"row",items:[n],shown:t}))]}function uT(s){return s&&s.rate<.8?`Simulated at ${s.rate}\xD7 real time`:""}function dT(s){let e=s?.packets;if(!e)return"";let t=Qe.map(n=>{let i=e.from[n];return`${n} hand: ${i?`from ${i}`:"no sender"}, ${e.lost[n]} packets lost`});return[`UDP packets: port ${e.port}${s.owner==="udp"?", in control of the hands":""}`,...t,`${e.ignored} packets ignored`].join(`
`)}function fT(s){return s?s.problem?s.problem:`Motion scale by MQTT: ${s.connected?"":"connecting, "}${s.topic}/set at ${s.broker}`:""}var pT={path:"The path of the tool along the protocol",rcm:"The point through which the shaft passes (RCM), and the shaft",workspace:"The positions that the tool can reach in its present direction",ghost:"Where the equations expect the tool",scenery:"The table and the patient of the protocol",labels:"Texts in the picture"};function Vg(s){let e=s.model,t=(c,h)=>({kind:"button",id:`show-${c}`,label:()=>h,on:()=>s.overlays.shows[c],hint:pT[c],press:()=>s.show(c)}),n=(c,h,u,d,f)=>({kind:"button",id:c,label:()=>h,hint:u,on:d,press:()=>{f(),s.showAround()}}),i=[[t("path","Tool path"),t("rcm","RCM and shaft")],[]];e.info?.has_workspace&&i[1]?.push(t("workspace","Workspace")),e.info?.scenery&&i[1]?.push(t("scenery","Table and patient"));let r=[];e.scene?.person&&r.push({kind:"button",id:"person",label:()=>"Person, for scale",hint:"Show an adult of 1.75 m beside the robot",on:()=>s.drawn.personal,press:()=>{s.stand(!s.drawn.personal)}}),e.scene?.drawn&&r.push(n("drawn","Drawn parts","Show what is drawn and not measured, such as belts, cables and drapes",()=>s.drawn.on,()=>{s.drawn.on=!s.drawn.on})),i.push(r);let o=e.scene?.props,a=e.scene?.cameras.length||e.robots.some(c=>c.info?.ports.length);o&&i.push([n("surroundings","Surroundings","Show or hide table, patient and walls",()=>!s.hidden,()=>s.hidden=!s.hidden),n("through","Transparent","See through the surroundings",()=>s.surroundings.seeThrough,()=>{s.surroundings.seeThrough=!s.surroundings.seeThrough})]),a&&i.push([n("marks","Ports and cameras","Mark the ports in the patient and the cameras",()=>s.surroundings.marks,()=>{s.surroundings.marks=!s.surroundings.marks})]),i.push([t("labels","Labels"),{kind:"button",id:"rich",label:()=>"Edges and reflections",hint:"Draw edges, and a room that shiny parts reflect; on at first if the device has a graphics processor",on:()=>s.rich,press:()=>s.enrich(!s.rich)},{kind:"button",id:"look",label:()=>"Bright, for additive displays",hint:"Brighter colours without a background, for glasses that add light to the room",on:()=>s.world.look==="additive",press:()=>s.setLook(s.world.look==="additive"?"normal":"additive")}]);let l=[{kind:"head",text:"Show"},...i.filter(c=>c.length).map(c=>({kind:"row",items:c}))];return l.push({kind:"text",id:"drawn-notes",tone:()=>"faint",text:()=>s.drawn.notes}),l.push({kind:"text",id:"patient",tone:()=>"faint",text:()=>s.overlays.sceneryText(e.robot)}),l.push({kind:"text",id:"cloud",tone:()=>"faint",text:()=>s.cloudText()}),e.info?.variants.length&&l.push({kind:"choice",id:"variant",label:"Ghost of the equations: variant",hint:"Show where a variant of the equations, such as the printed one, expects the tool",options:()=>[["","not shown"],...(e.info?.variants??[]).map(c=>[c,c])],get:()=>e.state.variant??"",set:c=>s.ask("variant",{name:c||null})},{kind:"text",id:"ghost",tone:()=>"faint",text:()=>s.overlays.ghostText}),l.push({kind:"head",text:"Size and place"},{kind:"slider",id:"scale",label:"Size",hint:"Show everything smaller or larger",range:()=>[-1,1],get:()=>Math.log10(s.place.scale),set:c=>s.place.setScale(10**c),show:c=>`${(10**c).toFixed(2)}\xD7`},{kind:"slider",id:"yaw",label:"Turn",hint:"Turn everything about the vertical",range:()=>[-Math.PI,Math.PI],get:()=>s.place.yaw,set:c=>s.place.setYaw(c),show:c=>`${(180/Math.PI*c).toFixed(0)}\xB0`},{kind:"slider",id:"height",label:"Height",hint:"Lift or lower everything",range:()=>[-.5,1.5],get:()=>s.place.height,set:c=>s.place.setHeight(c),show:c=>`${(100*c).toFixed(0)} cm`},{kind:"row",items:[{kind:"button",id:"place",label:()=>"Place on the floor",on:()=>s.place.placing,off:()=>!s.xr.canPlace,press:()=>s.place.begin(),hint:"Point at the floor of your room to place the robot there; only in AR, with a headset"},{kind:"button",id:"move",label:()=>"Move by hand",on:()=>s.place.moving,off:()=>!s.xr.presenting,press:()=>{s.place.moving=!s.place.moving,s.refresh()},hint:"Pinch to move the whole robot, with both hands to turn and scale it; only in a headset"},{kind:"button",id:"reset",label:()=>"Reset",hint:"Back to the size and place at the start",press:()=>s.place.reset()}]}),{id:"scene",label:"Scene",hint:"What is shown, and its size and place",controls:l}}function Wg(s){let e=s.model,t=[...e.info?.assumed??[],...e.scene?.assumed??[]],n=t.length;return{id:"robot",label:"Robot",hint:"Joint values, connection, and numbers without a source",controls:[{kind:"text",id:"name",text:()=>e.info?.title||e.info?.name||""},{kind:"text",id:"about",tone:()=>"faint",text:()=>`${e.info?.links.length??0} links, ${e.info?.joints.length??0} joints, ${e.info?.joints.filter(i=>i.active).length??0} of them active
model ${e.info?.model_hash.slice(0,19)??""}`},{kind:"text",id:"values",text:()=>(e.info?.joints??[]).filter(i=>i.active).map(i=>`${i.name}  ${Ls(e.joint(i.name),ts(i))}`).join(`
`)},{kind:"text",id:"line",tone:()=>"faint",text:()=>s.lineText()},{kind:"head",text:n===1?"1 ASSUMED parameter":`${n} ASSUMED parameters`},{kind:"text",id:"assumed",tone:()=>"faint",text:()=>n?mT(t):"None: every number has a source."}]}}function mT(s){let e=new Map;for(let t of s){let[n="",...i]=t.split(": "),r=i.join(": ");e.set(r,[...e.get(r)??[],n])}return[...e].map(([t,n])=>`\u2022 ${n.join(", ")}: ${t}`).join(`
`)}var eh=[.1,.25,.5,1,2,4];function $g(s){let t=[...s.console?[Gg(s,s.console)]:[_T(s),TT(s)],Vg(s),Wg(s)];if(s.model.several)for(let n of t)n.id!=="console"&&n.controls.unshift(gT(s,n.id));return{tabs:t,folds:!!(s.console?.info.task&&s.console.info.tools.length),transport:s.console?[Hg(s.console),s.console.plan.controls(),...s.console.info.task?gg(s):[]]:vT(s),status:{kind:"text",id:"status",text:()=>s.model.status().text,tone:()=>s.model.status().tone},lost:()=>s.model.line==="reconnecting"||s.model.line==="refused"}}function gT(s,e){return{kind:"choice",id:`robot-${e}`,label:"Robot",hint:"The robot to which these controls belong",options:()=>s.model.robots.map((t,n)=>[String(n),xT(s,t.info?.name??"")]),get:()=>String(s.model.chosen),set:t=>s.choose(Number(t))}}function xT(s,e){let t=s.console?.info.called[e];return t?`${t.replace(/^the /,"").replace(/ \(.*\)$/,"")} \xB7 ${e}`:e}var yT=s=>`${s.toFixed(2)} s`;function vT(s){let e=()=>s.model.state,t=()=>e().duration<=0;return[{kind:"row",items:[{kind:"button",id:"play",label:()=>e().playing?"\u275A\u275A Pause":"\u25B6 Play",hint:"Play the protocol, or pause (Space)",off:t,on:()=>e().playing,press:()=>s.ask("play",{on:!e().playing})},{kind:"button",id:"begin",label:()=>"|\u25C0 Start",off:t,hint:"Go to the start of the protocol",press:()=>s.ask("seek",{t:0})},{kind:"button",id:"loop",label:()=>"\u21BB Loop",hint:"Play the protocol again and again",off:t,on:()=>e().loop,press:()=>s.ask("loop",{on:!e().loop})},{kind:"button",id:"slower",label:()=>"\u2013 slower",hint:"Play more slowly",off:t,press:()=>s.ask("speed",{value:Xg(e().speed,-1)})},{kind:"button",id:"speed",label:()=>`${e().speed}\xD7`,off:t,press:()=>s.ask("speed",{value:1}),hint:"Play in real time"},{kind:"button",id:"faster",label:()=>"+ faster",hint:"Play faster",off:t,press:()=>s.ask("speed",{value:Xg(e().speed,1)})}]},{kind:"slider",id:"time",label:"Time",hint:"Go to a time of the protocol",off:t,range:()=>[0,Math.max(e().duration,.001)],get:()=>s.clipTime(),set:n=>s.seek(n),show:n=>`${n.toFixed(2)} / ${e().duration.toFixed(2)} s`,segments:()=>e().phases}]}function Xg(s,e){let t=eh.findIndex(n=>n>=s-1e-9);return eh[Math.max(0,Math.min(eh.length-1,(t<0?eh.length-1:t)+e))]??1}function _T(s){let e=s.model,t=[],n=e.info?.protocols??[];return n.length&&t.push({kind:"choice",id:"protocol",label:"Protocol",hint:"The motion that Play shows",options:()=>n.map(i=>[i.name,i.name]),get:()=>e.state.planning??e.state.protocol??"",set:i=>s.ask("protocol",{name:i})}),t.push({kind:"text",id:"title",tone:()=>"faint",text:()=>{if(!n.length)return"This robot has no protocol to play.";let i=e.state.planning??e.state.protocol,r=n.find(o=>o.name===i)?.title??"";return e.state.planning?`${r} (planning \u2026)`:r}},{kind:"text",id:"phase",text:()=>bT(s)},{kind:"text",id:"phases",tone:()=>"faint",text:()=>e.state.phases.map(([i,r,o],a)=>`${a+1}  ${i}  ${r.toFixed(2)}\u2013${yT(o)}`).join(`
`)},{kind:"row",items:[{kind:"button",id:"previous",label:()=>"\u2039 previous phase",hint:"Go to the start of the phase before",off:()=>!e.state.phases.length,press:()=>s.phase(-1)},{kind:"button",id:"next",label:()=>"next phase \u203A",hint:"Go to the start of the next phase",off:()=>!e.state.phases.length,press:()=>s.phase(1)}]},...wT(s)),e.state.recording!==void 0&&t.push({kind:"row",items:[{kind:"button",id:"record",label:()=>e.state.recording?"\u25A0 Stop recording":"\u25CF Record",hint:"Record what you and other clients do, into the file of --record",on:()=>e.state.recording===!0,press:()=>s.ask("record",{on:!e.state.recording})}]}),{id:"simulation",label:"Simulation",hint:"Play the protocols of the robot, and see what is measured",controls:t}}function bT(s){let e=s.model.state;if(!e.phases.length)return"";let t=s.clipTime(),n=e.phases.findIndex(([,,i])=>t<=i+1e-9);return e.phase?`Phase ${(n<0?e.phases.length-1:n)+1} of ${e.phases.length}: ${e.phase}`:"The robot is not on the protocol; press Play to return to it."}var qg=1e-6,MT=1e-4;function wT(s){let e=(i,r,o=()=>"plain")=>({kind:"text",id:`measure-${i}`,text:()=>r(s.model.state),tone:()=>o(s.model.state)}),t=(i,r)=>i!==null&&Math.abs(i)>r?"bad":"plain",n=i=>i.residual_m??i.residual_rad;return[e("gap",i=>i.gap_m===null?"":`Loop gap  ${ko(i.gap_m)}`,i=>t(i.gap_m,qg)),e("residual",i=>i.scope!==null?`Equations \u2194 mechanism  ${i.scope}`:i.residual_rad!==null?`Equations \u2194 mechanism  ${ko(i.residual_rad,!0)}`:i.residual_m===null?"":`Equations \u2194 mechanism  ${ko(i.residual_m)}`,i=>i.scope===null?t(n(i),qg):"warn"),e("rcm",i=>i.rcm_error_m===null?"":`Distance of shaft from RCM  ${ko(i.rcm_error_m)}`,i=>t(i.rcm_error_m,MT)),e("depth",i=>i.depth_m===null?"":`Insertion depth  ${Wt(i.depth_m)}`)]}function ST(s){let e=s.model,t=e.info?.distances??[];if(!t.length)return[];let n=0,i=()=>t[n]??{name:"",drawn:0,lower:0,upper:0},r=l=>e.state.distances.find(([c])=>c===l)?.[1]??t[l]?.drawn??0,o=()=>e.heldByOther||e.line!=="open",a=null;return[{kind:"head",text:"Dimensions"},{kind:"choice",id:"distance",label:"Distance of two joints on a link",hint:"The length of a link that the slider changes",options:()=>t.map((l,c)=>[String(c),l.name]),get:()=>String(n),set:l=>{n=Number(l),a=null,s.refresh()}},{kind:"slider",id:"distance-value",label:"length",hint:"Change this length, and see which joints move; nothing is saved",range:()=>[i().lower,i().upper],get:()=>a??r(n),show:Wt,set:l=>{a=l},end:()=>{a!==null&&s.ask("distance",{index:n,value:a}),a=null},off:o},{kind:"row",items:[{kind:"button",id:"as-drawn",label:()=>"As drawn",off:()=>o()||!e.state.distances.length,press:()=>s.ask("distance",{}),hint:"Set all distances back to those of the CAD"}]},{kind:"text",id:"changed",tone:()=>e.state.distances.length?"warn":"faint",text:()=>e.state.distances.length?[...e.state.distances.map(([l,c])=>`${t[l]?.name??""}: ${Wt(c)} (drawn: ${Wt(t[l]?.drawn??0)})`),"Protocols are still played as drawn."].join(`
`):"All distances are as drawn. A change moves joints; meshes keep their shape, and nothing is saved."}]}function TT(s){let e=s.model,t=[["auto","Tool","Grab the tool: it follows the hand. Grab another link: the grabbed point follows the hand."],["joint","Joint","Grab a link: the active joint that moves this link follows the hand."],["link","Link","Grab a link at any point: the mechanism moves so that the point follows the hand."]],n=(o,a)=>({kind:"button",id:`mode-${o}`,label:()=>a,hint:t.find(([l])=>l===o)?.[2]??"",on:()=>s.grab.mode===o,press:()=>{s.grab.mode=o,s.refresh()}}),i=[{kind:"head",text:"What a grab moves"},{kind:"row",items:t.map(([o,a])=>n(o,a))},{kind:"text",id:"how",tone:()=>"faint",text:()=>`${t.find(([o])=>o===s.grab.mode)?.[2]??""} ${s.how()}`},{kind:"row",items:[{kind:"button",id:"turning",label:()=>"Tool rotates with the hand",hint:"Whether the tool also turns with the hand, or keeps its direction",on:()=>s.grab.turning,press:()=>{s.grab.turning=!s.grab.turning,s.refresh()}}]}],r=e.info?.postures??[];r.length&&i.push({kind:"head",text:"Postures"},{kind:"row",items:r.slice(0,6).map(o=>({kind:"button",id:`posture-${o}`,label:()=>o,hint:`Move the robot to the posture ${o}`,press:()=>s.ask("posture",{name:o})}))}),i.push({kind:"head",text:"Joints"});for(let o of e.info?.joints.filter(a=>a.active)??[]){let a=ts(o),l={kind:"slider",id:`joint-${o.name}`,label:o.name,hint:`Move joint ${o.name}; the other active joints stay`,range:()=>[o.lower??(a?-Math.PI:-1),o.upper??(a?Math.PI:1)],get:()=>e.joint(o.name),show:c=>Ls(c,a),begin:()=>{s.grab.startJoint(s.member,o)},set:c=>s.grab.moveJoint(c),end:()=>s.grab.end(),off:()=>e.heldByOther||e.line!=="open"};i.push(l)}return i.push(...ST(s)),{id:"interaction",label:"Interaction",hint:"Move the robot by hand, by joints and by lengths",controls:i}}var AT=.25,Dd=.12,th=class{constructor(e){this.world=e;e.robotWorld.add(this.props)}world;props=new Pe;seeThrough=!1;marks=!0;rings=[];eyes=[];labels=[];opacities=new Map;async load(e){if(!e.props)return;let t=await oi(e.props.file);this.props.add(...ns(t.scene)),this.props.traverse(n=>{if(!(n instanceof ue))return;let i=n;i.material=i.material.clone(),this.opacities.set(i,i.material.opacity)})}mark(e,t){for(let n of t)for(let i of n.model.info?.ports??[]){let r=new ue(new gs(1,.12,10,40),At(Uo));r.position.fromArray(i.at),r.scale.setScalar(.014*this.world.size),n.place.add(r),this.rings.push(r)}for(let n of e.cameras){let r=t.find(o=>o.model.info?.name===n.robot)?.robot?.links.get(n.link)?.node;r&&r.add(this.eye(n))}}eye(e){let t=new Pe,{p:n,q:i}=Mn(e.T_link_camera);t.position.copy(n),t.quaternion.copy(i);let r=Dd*Math.tan(e.view/2),o=[[-1,-1],[1,-1],[1,1],[-1,1]].map(([h,u])=>[r*(h??0),r*(u??0),Dd]),a=o.flatMap((h,u)=>[0,0,0,...h,...h,...o[(u+1)%4]]),l=new Ye().setAttribute("position",new Ue(a,3));t.add(new vn(l,Ci(new Ot({toneMapped:!1}))));let c=new sn;return c.sprite.position.set(0,0,Dd),c.say(e.name,"#12438a","normal",.013*this.world.size),t.add(c.sprite),this.labels.push(c),this.eyes.push(t),t}get parts(){return[...this.opacities.keys()]}get signs(){return[...this.rings,...this.eyes]}show(e,t){this.props.visible=e;for(let n of[...this.rings,...this.eyes])n.visible=this.marks;for(let n of this.labels)n.sprite.visible=t&&this.marks;for(let[n,i]of this.opacities){let{material:r}=n;r.opacity=this.seeThrough?Math.min(i,AT):i;let o=r.opacity<1;r.transparent!==o&&(r.needsUpdate=!0),r.transparent=o,r.depthWrite=n.castShadow=!o}this.world.touch()}brighten(e){for(let{material:t}of this.opacities.keys())t.emissive=e?t.color.clone().multiplyScalar(.18):new ve(0);this.world.touch()}finish(e,t,n){let i=this.props.children.find(l=>l.name===e),[r,o,a]=t;i?.traverse(l=>{if(!(l instanceof ue))return;let c=l;c.material.color.setRGB(r??1,o??1,a??1),n&&(Pr(c.geometry),c.material.map=Cr(),c.material.roughness=.5,c.material.needsUpdate=!0)}),this.world.touch()}box(){let e=new vt;return this.props.children.length?(this.world.robotWorld.updateMatrixWorld(!0),e.setFromObject(this.props),e.applyMatrix4(this.world.robotWorld.matrixWorld.clone().invert())):e}};var ET=["local-floor","hit-test","hand-tracking"],RT=1.4,Yg=.68,CT=1500,nh=class{constructor(e){this.app=e}app;ar=!1;vr=!1;text="Looking for a headset \u2026";session=null;mode=null;blend="";canPlace=!1;frames=0;floor=0;viewerHits=null;pointerHits=new Map;settled=!1;awaySince=0;position=new S;quaternion=new De;backdrop="normal";get presenting(){return this.session!==null}async detect(){let e=navigator.xr;if(!e)this.text=window.isSecureContext?"This browser does not support WebXR. Use mouse or touch on this screen.":"A headset requires https: start twin serve with --cert and --key. Use mouse or touch on this screen.";else{let t=n=>e.isSessionSupported(n).catch(()=>!1);[this.ar,this.vr]=await Promise.all([t("immersive-ar"),t("immersive-vr")]),this.text=this.ar?"AR is available: the robot is shown in your room.":this.vr?"VR is available, AR is not: the robot is shown in an empty room.":"No headset found. Use mouse or touch on this screen, or open this address in the browser of a headset.",e.ondevicechange=()=>{this.detect()}}this.app.refresh()}async enter(e=this.ar?"immersive-ar":"immersive-vr"){let t=navigator.xr;if(!t||this.session)return;let{renderer:n}=this.app.world;try{let i=await t.requestSession(e,{optionalFeatures:ET}),r=await i.requestReferenceSpace("local-floor").then(()=>!0,()=>!1);n.xr.setReferenceSpaceType(r?"local-floor":"local"),this.floor=r?0:-RT,i.addEventListener("end",()=>this.ended()),this.session=i,this.mode=e,this.blend=i.environmentBlendMode??"opaque",this.settled=!1,this.frames=0,await n.xr.setSession(i),this.begun()}catch(i){this.session=null,e==="immersive-ar"&&this.vr?(this.app.model.say("AR could not be started; trying VR."),await this.enter("immersive-vr")):this.app.model.say(`The headset did not start the session: ${i.message}`)}}async leave(){await this.session?.end()}viewer(){return this.position}head(e){e.position.copy(this.position),e.quaternion.copy(this.quaternion),e.updateMatrixWorld(!0)}update(e,t){let{app:n}=this,i=n.world.renderer.xr.getReferenceSpace(),r=i?e.getViewerPose(i):void 0;if(!i||!r)return;this.frames++;let{position:o,orientation:a}=r.transform;this.position.set(o.x,o.y,o.z),this.quaternion.set(a.x,a.y,a.z,a.w);let l=new S(0,0,-1).applyQuaternion(this.quaternion);!this.settled&&n.robot&&(this.settled=!0,n.place.before(this.position,l,this.floor),n.xrPanel.placeBefore(this.position,l,n.console?Yg:void 0),n.console?.screen.placeBefore(this.position,l),this.canPlace&&!n.console&&n.place.begin()),n.console?.hands.update(e,i,t),this.aim(e,i),this.fetchPanel(l,t)}begun(){let{app:e}=this,t=this.blend!=="opaque";this.backdrop=e.world.look,e.xrPanel.group.visible=!0,e.setLook(this.blend==="additive"?"additive":e.world.look,t),this.prepareHits(),e.refresh()}async prepareHits(){let e=this.session;if(!(!e?.requestHitTestSource||this.mode!=="immersive-ar")&&!(e.enabledFeatures&&!e.enabledFeatures.includes("hit-test"))){try{let t=await e.requestReferenceSpace("viewer");this.viewerHits=await e.requestHitTestSource({space:t})??null,this.canPlace=this.viewerHits!==null,this.canPlace&&!this.app.console&&this.app.place.begin()}catch{this.canPlace=!1}this.app.refresh()}}aim(e,t){let{place:n,hands:i}=this.app;if(!n.placing)return n.aim(null);let r=i.pointing;for(let o of r)this.pointerHits.has(o)||this.askHits(o);for(let o of[...r.map(a=>this.pointerHits.get(a)),this.viewerHits])if(o)for(let a of e.getHitTestResults(o)){let l=a.getPose(t);if(!l)continue;let c=new _e().fromArray(l.transform.matrix);if(!(new S().setFromMatrixColumn(c,1).y<.8))return n.aim(new _e().setPosition(new S().setFromMatrixPosition(c)))}n.aim(null)}askHits(e){this.pointerHits.set(e,null),this.session?.requestHitTestSource?.({space:e.targetRaySpace})?.then(t=>this.pointerHits.set(e,t),()=>{})}fetchPanel(e,t){let{xrPanel:n}=this.app;n.outOfSight(this.position,e)?t-this.awaySince>CT&&(n.placeBefore(this.position,e,this.app.console?Yg:void 0),this.awaySince=t):this.awaySince=t}ended(){let{app:e}=this;this.session=null,this.mode=null,this.viewerHits=null,this.pointerHits.clear(),this.canPlace=!1,e.hands.forget(),e.console?.hands.forget(),e.console?.screen.hide(),e.place.placing=e.place.moving=!1,e.place.aim(null),e.xrPanel.group.visible=!1,e.place.reset(),e.setLook(this.backdrop,!1),e.world.resize(),e.refresh()}};var PT=new Set(["target","plan","clearance"]),Nd=1500,IT=50,ih=class{model=new lc;world;line;members=[];fields=new sc;objects=new Zc;surroundings;drawn;grab;place;xr;hands;xrPanel=new jc;console=null;firstPicture=NaN;dom;header;mouse;score;machines=null;sheet=null;seeking=NaN;seekUntil=0;stale=!0;loaded=!1;early=[];bends=[];laid=null;hidden=!1;rich=!1;refreshed=0;ahead=!1;waiting=0;due=0;constructor(e,t){this.world=new mc(e);let n=location.protocol==="https:"?"wss":"ws";this.line=new Wl(`${n}://${location.host}/ws`),this.surroundings=new th(this.world),this.drawn=new Ic(this.world),this.world.robotWorld.add(this.fields.group,this.objects.group),this.join(),this.grab=new Lc(this.world,this.members,this.line),this.place=new Jc(this.world),this.xr=new nh(this),this.hands=new Uc(this),this.header=new Vc(t,this),this.dom=new $c(t),this.score=new bc(t,this),this.mouse=new qc(this),this.world.scene.add(this.xrPanel.group),this.wire()}get member(){return this.members[this.model.chosen]}get robot(){return this.member.robot}get overlays(){return this.member.overlays}start(){this.line.open(),jm(),this.world.renderer.setAnimationLoop((e,t)=>{this.ahead=!1,this.picture(e,t)}),this.xr.detect(),this.load().catch(e=>this.fail(e))}async ask(e,t){let n=await this.line.ask(e,this.model.robot.fields(e,t));return n.ok||this.model.say(n.message),n.ok}seek(e){this.seeking=e,this.seekUntil=performance.now()+400,this.line.tell("seek",{t:e}),this.refresh()}clipTime(){return performance.now()<this.seekUntil?this.seeking:this.model.time}phase(e){let t=this.clipTime(),n=this.model.state.phases.map(([,r])=>r),i=e>0?n.find(r=>r>t+1e-6):n.findLast(r=>r<t-.3);this.seek(i??(e>0?this.model.state.duration:0))}show(e){let t=!this.overlays.shows[e];for(let n of e==="workspace"?[this.member]:this.members)n.overlays.shows[e]=t;e==="workspace"&&this.ask("workspace",{on:t}),this.showAround()}showAround(){this.surroundings.show(!this.hidden,this.overlays.shows.labels),this.drawn.show(this.drawn.on,!this.hidden&&!this.surroundings.seeThrough),this.objects.show(this.overlays.shows.labels),this.console?.views.backdrop.forget(),this.refresh()}choose(e){e===this.model.chosen||!this.members[e]||(this.model.chosen=e,this.build())}take(e){return this.choose(this.members.indexOf(e.member)),this.grab.start(e)}setLook(e,t=this.xr.presenting&&this.xr.blend!=="opaque"){this.world.setLook(e,t);for(let{robot:n}of this.members)n?.brighten(e==="additive");this.surroundings.brighten(e==="additive"),this.xrPanel.look=e,Fm(e==="additive"),document.documentElement.dataset.look=e,this.console?.views.backdrop.forget(),this.refresh()}async adorn(e){let{scene:t}=this.model;if(t){try{await this.drawn.load(t,this.members,this.surroundings)}catch{this.model.say("The drawn parts, such as belts and drapes, could not be loaded. Reload the page to try again.")}this.showAround(),e&&this.enrich(!0)}}async stand(e){await this.drawn.stand(this.model.scene?.person,e,this.whole());let t=this.whole(),n=this.drawn.box();n.isEmpty()||t.union(n),this.frameAll(t),this.refresh()}whole(){let e=new vt;for(let n of this.members)e.union(n.box());let t=this.surroundings.box();return t.isEmpty()||e.union(t).min.setZ(Math.min(0,e.min.z)),e}enrich(e){this.rich=e;for(let{robot:t}of this.members)t?.outlineAll(e);this.world.reflect(e),this.refresh()}how(){return this.xr.presenting?this.hands.count?"Point at a link, then pinch or pull the trigger.":"No hand or controller is tracked: look at a link for a moment to grab it, and keep still to release it.":"Drag with the left button. Shift rotates the tool, the wheel moves it along the view."}hint(){if(!this.xr.presenting)return"";let e=this.hands.count?"pinch or pull the trigger":"look there for a moment";return this.place.placing?`Point at the floor and ${e}: the robot will be placed there.`:this.place.moving?"Pinch to move the whole robot; pinch with both hands to turn and scale it.":""}cloudText(){return this.overlays.shows.workspace?`Workspace in the present orientation: ${this.overlays.cloudCount.toLocaleString("en")} points${this.overlays.cloudDone?"":" so far"}; blue: well conditioned, red: near a singularity.`:""}lineText(){let{roundTrip:e,frames:t,reconnects:n}=this.line,i=Number.isFinite(e)?`${e.toFixed(0)} ms round trip`:"";return`client ${this.model.client??"\u2013"}, ${i}
${t} frames, ${n} reconnects
${this.world.pace.text()}`}later(e){let t=performance.now()+e;this.waiting&&this.due<=t||(window.clearTimeout(this.waiting),this.due=t,this.waiting=window.setTimeout(()=>{this.waiting=0,this.world.dirty=!0},e))}inform(){this.stale=!0,this.console&&this.loaded&&this.world.pace.slow&&!this.xr.presenting?this.later(Nd):this.world.dirty=!0}refresh(){this.stale=!0,this.world.dirty=!0}join(){let e=this.model.robots[this.members.length];this.members.push(new Xc(this.world,e))}async load(){let e=await LT();for(this.model.meet(e);this.members.length<this.model.robots.length;)this.join();document.title=`${e.name} \xB7 twin`,this.fields.meet(e.fields),e.console&&(this.console=new Pc(this,e,e.console)),e.machines&&(this.machines=new Qc(document.getElementById("page"),this,e.machines));for(let i of this.early.splice(0))this.hear(i);this.build();let t=this.surroundings.load(e),n=await Promise.all(e.robots.map(i=>cc.load(i)));await Promise.all([t,this.objects.load(e.objects)]),this.adopt(e,n)}adopt(e,t){let{world:n,members:i}=this;i.forEach((a,l)=>a.adopt(t[l]));let r=this.whole();if(n.size=r.getSize(new S).length()/1.5,i.length>1)for(let{overlays:a}of i)a.setSize(a.size,.013*n.size);let o=r.getCenter(new S);n.robotWorld.position.set(-o.x,-r.min.z,o.y),this.surroundings.mark(e,i),this.setLook(n.look),this.place.reset(),this.frameAll(r),this.console?.views.mount(),this.bend(),this.showAround(),n.touch(),this.loaded=!0}cover(){let[e,t]=this.dom.covers(),n=this.console?0:this.header.covers(window.innerWidth-e);return this.world.cover(this.machines?.covers()??this.score.covers(),e,t,n)}frameAll(e){this.cover();let t=e.getSize(new S);this.world.frameAll(new S(0,t.z/2,0),t.length()/2)}showPanel(e){this.sheet&&this.xrPanel.show(e?{...this.sheet,tabs:[e,...this.sheet.tabs]}:this.sheet)}build(){this.sheet=$g(this),this.dom.show(this.sheet),this.showPanel(this.console?.forms.tab()??null),this.refresh()}fail(e){this.model.failure=e.message,this.refresh()}wire(){this.model.onChange=()=>this.inform(),this.model.hint=()=>this.hint(),this.grab.onChange=()=>this.refresh(),this.place.onChange=()=>this.refresh(),this.line.onMessage=e=>this.hear(e),this.line.onFrame=()=>this.arrive(),this.world.pace.onDrawn=()=>this.arrive(),this.line.onLine=e=>{this.model.line=e,e!=="open"&&this.console?.pens.drop(),e!=="open"&&this.grab.held&&this.grab.drop("The connection was lost: the robot was released."),this.refresh()}}hear(e){let t=this.model.state.recording;if(!this.model.scene&&PT.has(e.type)){this.early.push(e);return}if(e.type==="path"||e.type==="cloud"){if(e.robot!==void 0&&!this.model.scene){this.early.push(e);return}let n=this.members[this.model.named(e.robot)]?.overlays;e.type==="path"?n?.setPath(e.points):n&&(e.first&&n.clearCloud(),n.shows.workspace=!0,n.addCloud(e.points,e.values,e.done))}if(this.machines?.hear(e),e.type==="forces"&&this.console?.forces.hear(e),e.type==="state"&&(this.line.hurries=e.console?.leaving??!1),e.type==="error"&&e.code==="released"&&this.grab.drop(e.message),this.model.hear(e),this.console?.plan.hear(e),e.type==="state"){for(let{model:n,overlays:i}of this.members)!n.state.workspace&&i.cloudCount&&i.clearCloud();this.model.info&&t===void 0!=(this.model.state.recording===void 0)&&this.build()}}picture(e,t){let{world:n}=this,i=this.line.take();if(i&&this.takeFrame(i),t&&this.xr.presenting&&this.xr.update(t,e),this.hands.update(e),this.mouse.update(),this.console?.update(e),this.grab.update(),this.stale||e-this.refreshed>250){this.stale=!1,this.refreshed=e;for(let r of this.members)r.robot&&r.overlays.update(r.model,r.robot);this.header.refresh(),this.xr.presenting||(this.dom.refresh(),this.cover()&&(this.console?this.console.views.place():this.world.frameAgain()),this.score.refresh(),this.machines?.refresh(),this.console?.tools?.refresh()),this.loaded&&this.console?.heads.refresh(),this.xrPanel.refresh()}if(this.xrPanel.update(e),!(!this.xr.presenting&&!n.dirty)){if(this.xr.presenting)this.console&&this.loaded&&this.console.screen.draw(e),n.renderer.render(n.scene,n.camera);else if(!this.draw())return;n.dirty=!1}}draw(){let{world:e}=this,{pace:t}=e;if(t.busy)return!1;let n=performance.now()-e.moved<Nd;return t.begin(n),n&&t.slow&&this.later(Nd),this.console&&this.loaded?this.console.views.render():e.renderer.render(e.scene,e.camera),t.end(),this.ahead=!0,this.loaded&&Number.isNaN(this.firstPicture)&&(this.firstPicture=performance.now(),window.setTimeout(()=>{this.adorn(!t.software)})),!0}arrive(){if(this.ahead||this.xr.presenting||!this.loaded||!this.world.pace.slow||this.world.pace.busy)return;let e=this.line.take();e&&this.takeFrame(e),!(!this.world.dirty||performance.now()-this.world.moved>IT)&&(this.world.dirty=!this.draw())}takeFrame(e){let{model:t}=this,n=t.robots.map(o=>o.frame);try{let o=Cm(e);t.take(o),this.bends=o.fields,this.laid=o.robots[this.members.length]??null}catch(o){t.say(o.message);return}let i=this.members.filter(({model:o},a)=>o.frame&&!Rm(o.frame,n[a]??null));for(let o of i)o.follow();i.length&&this.drawn.update();let r=this.bend();!i.length&&!r||(this.world.moved=performance.now(),this.world.touch(),this.stale=!0)}bend(){return[this.fields.update(this.bends),this.loaded&&this.objects.update(this.laid)].includes(!0)}};async function LT(){let s=await fetch("scene.json");if(!s.ok)throw new Error(s.status===403?"Access denied: open the address with the token that twin serve prints on its terminal.":`The server did not send the description of the scene (HTTP ${s.status}).`);return await s.json()}function Kg(s){let{world:e}=s,t=[],n=(i,r)=>s.members.length>1?`${i.model.info?.name}/${r}`:r;window.twin={app:s,links:()=>(e.scene.updateMatrixWorld(!0),Object.fromEntries(s.members.flatMap(i=>[...i.robot?.links??[]].map(([r,o])=>[n(i,r),o.node.matrixWorld.toArray()])))),root:()=>e.robotWorld.matrixWorld.toArray(),poses:()=>Object.fromEntries(s.members.flatMap(i=>{let{info:r,frame:o}=i.model;return!r||!o?[]:r.links.map((a,l)=>[n(i,a),[...o.poses.subarray(7*l,7*l+7)]])})),field:i=>s.fields.vertices(i),camera:()=>{let i=e.renderer.xr,r=i.isPresenting?i.getCamera().cameras[0]??e.camera:e.camera,{width:o,height:a}=e.renderer.domElement;return{view:r.matrixWorldInverse.toArray(),projection:r.projectionMatrix.toArray(),width:o,height:a}},paint:i=>{s.drawn.show(!i,!0);let r=0;for(let{robot:a}of s.members)a?.paint(i,r),r+=a?.links.size??0;if(i){let a=s.members.map(c=>c.place),l=e.scene.children.filter(c=>c!==e.placement);l.push(...e.robotWorld.children.filter(c=>!a.includes(c)));for(let c of s.members)l.push(...c.place.children.filter(h=>h!==c.robot?.root));for(let c of l.flatMap(h=>[h,...h.children]))c.visible&&(c.visible=!1,t.push(c))}else for(let a of t.splice(0))a.visible=!0;e.touch();let o=s.members.flatMap(a=>[...a.robot?.links??[]].map(([l,c])=>{let h=c.skins[0]?.mesh.material;return[n(a,l),h?.color?.getHexString()??""]}));return Object.fromEntries(o)}}}var sh=64,jg=[["ff0000",.5,0],["00ff00",0,.5],["0000ff",-.5,-.5]];function Zg(s){let e="a picture has the right colours at the right places";if(!s)return[{name:e,verdict:"FAIL",said:"no WebGL 2"}];let t=new Ar({canvas:document.createElement("canvas")}),n=new Tt(sh,sh,{colorSpace:Wn}),i=new yi;for(let[l,c,h]of jg){let u=new ue(new Vt(.3,.3),new lt({color:`#${l}`,toneMapped:!1}));u.position.set(c,h,0),i.add(u)}let r=new dt(90,1,.1,10);r.position.z=1,t.setRenderTarget(n),t.render(i,r);let o=[],a=new Uint8Array(4);for(let[l,c,h]of jg){let[u,d]=[Math.round(sh/2*(1+c)),Math.round(sh/2*(1+h))];t.readRenderTargetPixels(n,u,d,1,1,a);let f=[...a.subarray(0,3)].map(g=>g.toString(16).padStart(2,"0")).join("");f!==l&&o.push(`${l} is ${f}`)}return n.dispose(),t.dispose(),t.forceContextLoss(),[{name:e,verdict:o.length?"FAIL":"pass",said:o.join(", ")||"3 of 3 colours"}]}var Jg="VFdOMQcAAAAAAAAAAAApQAAAAAAAAApAAgABAAUAAAAAAIA/AAAAQAAAQEAAAAAAAAAAAAAAAAAAAIA/AACAPgAAAL8AAAA+AAAAPwAAAD8AAAA/AAAAPwAAQD8AAIA/AAAAAAAAAAAAAAAAmpkZPwAAAADNzEw/",DT=[0,0,-1,0,0,1,0,0,1,0,0,0,.25,.125,.5,1],NT=120,rh=class{constructor(e,t){this.app=e;let n=document.createElement("section");n.className="selftest";let i=document.createElement("h1");i.textContent="Self-test";let r=document.createElement("p");r.textContent="Press once. With a headset, the page enters XR, shows markers on the floor and measures for some seconds. Without a headset, it runs the other tests. The authors have not yet run this page on a headset.";let o=document.createElement("button");o.className="enter",o.dataset.id="selftest",o.textContent="Run the self-test",o.onclick=()=>{this.run()},this.list.dataset.id="results",this.verdict.dataset.id="verdict",n.append(i,r,o,this.verdict,this.list),t.append(n),this.markers.visible=!1,e.world.scene.add(this.markers),this.stand()}app;results=[];done=!1;list=document.createElement("ol");verdict=document.createElement("p");markers=new Pe;async run(){this.results.length=0,this.done=!1,this.markers.visible=!0;let{app:e}=this,t=e.xr.ar||e.xr.vr?e.xr.enter():null;this.numbers(),this.results.push(...Zg(e.world.renderer.capabilities.isWebGL2)),await this.stream(),await t,e.xr.session?await this.session(e.xr.session):this.add("headset","not here",e.xr.text),this.done=!0,this.show()}numbers(){this.attempt("a frame of the stream is decoded",()=>{let e=Uint8Array.from(atob(Jg),i=>i.charCodeAt(0)),t=Rr(e.buffer),n=[t.seq,t.serverTime,t.clipTime,t.flags,t.q[0],t.poses[8],t.ghost?.[6]];return Qg(n.map(Number),[7,12.5,3.25,5,.75,-.5,Math.fround(.8)])}),this.attempt("z up is converted to y up exactly once",()=>{let e=Uint8Array.from(atob(Jg),i=>i.charCodeAt(0)),t=new Pe;t.rotation.x=-Math.PI/2;let n=new Pe;return t.add(n),n.position.fromArray(Rr(e.buffer).poses,7),n.quaternion.fromArray(Rr(e.buffer).poses,10),t.updateMatrixWorld(!0),Qg(n.matrixWorld.toArray(),DT)})}async stream(){let{line:e,model:t}=this.app,n=e.frames,i=performance.now();await e0(2e3);let r=1e3*(e.frames-n)/(performance.now()-i),o=Number.isFinite(e.roundTrip)?`${e.roundTrip.toFixed(0)} ms round trip`:"no answer yet",a=e.line==="open"&&t.frame!==null;this.add("stream",a?"pass":"FAIL",a?`${r.toFixed(0)} frames/s, ${o}`:t.status().text);let l=this.app.robot;l&&t.frame&&t.info?this.links(l):this.add("links stand where the stream says","FAIL","no robot")}links(e){this.attempt("links stand where the stream says",()=>{let{member:t,model:n,world:i}=this.app;i.scene.updateMatrixWorld(!0);let r=n.frame?.poses??new Float32Array;return Math.max(...(n.info?.links??[]).map((o,a)=>{let l=e.links.get(o)?.node;return l?t.place.worldToLocal(l.getWorldPosition(new S)).distanceTo(new S().fromArray(r,7*a)):1/0}))})}async session(e){let{xr:t}=this.app,n=t.frames,i=performance.now();for(;t.session&&t.frames-n<NT&&performance.now()-i<2e4;)await e0(100);let r=1e3*(t.frames-n)/(performance.now()-i);this.add("session","pass",`${t.mode}, the display is ${t.blend}`),this.add("pictures",r>=30?"pass":"FAIL",`${r.toFixed(0)}/s, required: at least 30`);let o=this.app.world.renderer.xr.getCamera().cameras,[a,l]=o.map(u=>new S().setFromMatrixPosition(u.matrixWorld));if(a&&l){let u=1e3*a.distanceTo(l);this.add("eyes",u>45&&u<85?"pass":"FAIL",`${u.toFixed(1)} mm apart, required: 45 to 85`)}else this.add("eyes","not here","one view");let c=t.viewer().y;this.add("floor",c>.4&&c<2.4?"pass":"FAIL",`the head is ${c.toFixed(2)} m above the floor`),this.add("hit test",t.canPlace?"pass":"not here",t.canPlace?"available":"not available");let h=[...e.inputSources].map(u=>u.hand?"hand":u.targetRayMode);this.add("input",h.length?"pass":"not here",h.join(", ")||"none: use gaze")}stand(){let e=new ue(new ln(.1,.1,.1),At(15774761));e.position.set(0,.05,-1),this.markers.add(e);for(let i=0;i<10;i++){let r=new ue(new tn(.01,.01,.1,16),At(i%2?16777215:2255049));r.position.set(.3,.05+.1*i,-1),this.markers.add(r)}let t=[[new S(1,0,0),14162730],[new S(0,0,-1),1614685],[new S(0,1,0),2255049]];for(let[i,r]of t)this.markers.add(new vo(i,new S(-.35,.01,-1),.3,r,.06,.04));let n=new sn;n.say(`cube: 10 cm, 1 m ahead, on the floor
rod: 1 m high, pieces of 10 cm
red: right (x)  green: ahead (y)  blue: up (z)`,"#12438a","normal",.035),n.sprite.position.set(-.3,1.05,-1),n.sprite.visible=!0,this.markers.add(n.sprite)}attempt(e,t){try{let n=t();this.add(e,n<=1e-6?"pass":"FAIL",`worst error ${n.toExponential(1)}`)}catch(n){this.add(e,"FAIL",n.message)}}add(e,t,n){this.results.push({name:e,verdict:t,said:n}),this.show()}show(){let e=this.results.filter(i=>i.verdict==="FAIL").length,t=this.results.filter(i=>i.verdict==="not here").length,n=this.results.length-e-t;this.verdict.textContent=this.done?`${n} passed, ${e} failed, ${t} not here. ${navigator.userAgent}`:"Running \u2026",this.verdict.dataset.tone=e?"bad":"good",this.list.replaceChildren(...this.results.map(i=>{let r=document.createElement("li");return r.textContent=`${i.verdict}: ${i.name} (${i.said})`,r.dataset.verdict=i.verdict,r})),this.app.xrPanel.show(this.sheet())}sheet(){let e=t=>t.verdict==="pass"?"good":t.verdict==="FAIL"?"bad":"faint";return{tabs:[{id:"simulation",label:"Self-test",hint:"Results of the checks so far",controls:this.results.map((t,n)=>({kind:"text",id:`result-${n}`,text:()=>`${t.verdict}: ${t.name} (${t.said})`,tone:()=>e(t)}))}],transport:[{kind:"row",items:[{kind:"button",id:"leave",label:()=>"Leave the headset",hint:"End the self-test",press:()=>{this.app.xr.leave()}}]}],status:{kind:"text",id:"status",text:()=>this.verdict.textContent??"",tone:()=>"plain"},lost:()=>!1}}};function Qg(s,e){return Math.max(...e.map((t,n)=>Math.abs(t-(s[n]??NaN))).map(t=>Number.isNaN(t)?1/0:t))}var e0=s=>new Promise(e=>setTimeout(e,s));var OT=document.getElementById("view"),t0=document.getElementById("page"),Od=new ih(OT,t0);Kg(Od);Od.start();new URLSearchParams(location.search).has("selftest")&&(window.twin.test=new rh(Od,t0));
